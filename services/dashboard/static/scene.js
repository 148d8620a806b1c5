// Draws the scene of a log with WebGL: bodies in their frames, what is translucent last, shadows on the table.

import { triangles } from "./shapes.js";
import { after, lookAt, matrixOf, NO_TURN, perspective, shadowOnto, times } from "./vectors.js";

const LIGHT = [0.35, -0.25, 0.9];
const TABLE_TOP_M = 0.0006;
const TARGET = [0, 0, 0.1];
export const VIEWS = {
  corner: { yaw: -0.9, pitch: 0.5, distance: 0.98 },
  front: { yaw: -Math.PI / 2, pitch: 0.2, distance: 0.85 },
  side: { yaw: 0, pitch: 0.2, distance: 0.85 },
  top: { yaw: -Math.PI / 2, pitch: 1.55, distance: 0.8 },
};

const VERTEX = `#version 300 es
in vec3 at; in vec3 normal; in vec3 colour;
uniform mat4 view; uniform mat4 model;
out vec3 facing; out vec3 tint; out vec3 place;
void main() {
  vec4 world = model * vec4(at, 1.0);
  place = world.xyz; facing = mat3(model) * normal; tint = colour;
  gl_Position = view * world;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 facing; in vec3 tint; in vec3 place;
uniform vec3 light; uniform vec3 eye; uniform float opacity; uniform float flat_; uniform vec3 shade;
out vec4 shown;
void main() {
  if (flat_ > 0.5) { shown = vec4(shade, opacity); return; }
  vec3 n = normalize(facing);
  vec3 away = normalize(eye - place);
  if (dot(n, away) < 0.0) n = -n;
  float sun = max(dot(n, normalize(light)), 0.0);
  float gloss = pow(max(dot(n, normalize(normalize(light) + away)), 0.0), 40.0);
  float sky = 0.5 + 0.5 * n.z;
  float rim = pow(1.0 - max(dot(n, away), 0.0), 3.0);
  vec3 colour = tint * (0.34 + 0.26 * sky + 0.55 * sun) + 0.16 * gloss + 0.06 * rim;
  shown = vec4(colour, opacity + (1.0 - opacity) * 0.25 * rim * step(opacity, 0.99));
}`;

function compiled(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return program;
}

export class Scene {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, stencil: true, alpha: true });
    if (!gl) throw new Error("This browser shows no WebGL 2, which the replay needs; the plots are complete.");
    this.canvas = canvas;
    this.gl = gl;
    this.program = compiled(gl);
    this.where = Object.fromEntries(
      ["view", "model", "light", "eye", "opacity", "flat_", "shade"].map((name) => [name, gl.getUniformLocation(this.program, name)]),
    );
    this.bodies = [];
    this.hidden = new Set();
    this.camera = { ...VIEWS.corner };
    gl.useProgram(this.program);
    gl.enable(gl.DEPTH_TEST);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  // Entities of one frame, name and opacity become one body.
  load(entities) {
    const groups = new Map();
    for (const entity of entities) {
      const opacity = entity.colour[3];
      const key = `${entity.frame} ${entity.id} ${opacity}`;
      if (!groups.has(key)) groups.set(key, { frame: entity.frame, name: entity.id, opacity, rows: [] });
      const { rows } = groups.get(key);
      for (const value of triangles(entity, entity.colour.slice(0, 3))) rows.push(value);
    }
    this.bodies = [...groups.values()].map((group) => this.body(group)).sort((a, b) => b.opacity - a.opacity);
  }

  body({ frame, name, opacity, rows }) {
    const { gl } = this;
    const vertices = gl.createVertexArray();
    gl.bindVertexArray(vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(rows), gl.STATIC_DRAW);
    ["at", "normal", "colour"].forEach((attribute, index) => {
      const location = gl.getAttribLocation(this.program, attribute);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 36, 12 * index);
    });
    return { frame, name, opacity, vertices, count: rows.length / 9 };
  }

  eye() {
    const { yaw, pitch, distance } = this.camera;
    const flat = distance * Math.cos(pitch);
    return [TARGET[0] + flat * Math.cos(yaw), TARGET[1] + flat * Math.sin(yaw), TARGET[2] + distance * Math.sin(pitch)];
  }

  // ``frames`` gives the pose of each frame in the world.
  draw(frames) {
    const { gl, canvas, where } = this;
    const scale = Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const eye = this.eye(), aspect = width / Math.max(1, height);
    const lens = perspective(aspect < 1 ? 0.95 : 0.68, aspect, 0.05, 5);
    gl.uniformMatrix4fv(where.view, false, times(lens, lookAt(eye, TARGET)));
    gl.uniform3fv(where.light, LIGHT);
    gl.uniform3fv(where.eye, eye);
    const seen = this.bodies.filter((body) => !this.hidden.has(body.name) && frames(body.frame));
    const solid = seen.filter((body) => body.opacity >= 0.99);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    for (const body of solid) this.show(body, matrixOf(frames(body.frame)), 1);
    this.shadows(solid.filter((body) => body.frame !== "world"), frames);
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    this.glass(seen.filter((body) => body.opacity < 0.99), frames);
    gl.depthMask(true);
  }

  // Of each translucent body a place shows one layer only, so that the seams of its parts do not show.
  glass(bodies, frames) {
    const { gl } = this;
    gl.clear(gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
    bodies.forEach((body, index) => {
      gl.stencilFunc(gl.NOTEQUAL, index + 1, 255);
      this.show(body, matrixOf(frames(body.frame)), body.opacity);
    });
    gl.disable(gl.STENCIL_TEST);
  }

  show(body, model, opacity, isFlat = 0) {
    const { gl, where } = this;
    gl.uniformMatrix4fv(where.model, false, model);
    gl.uniform1f(where.opacity, opacity);
    gl.uniform1f(where.flat_, isFlat);
    gl.bindVertexArray(body.vertices);
    gl.drawArrays(gl.TRIANGLES, 0, body.count);
  }

  // The stencil lets each place be darkened once, however many bodies shade it.
  shadows(bodies, frames) {
    const { gl, where } = this;
    gl.enable(gl.BLEND);
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.depthMask(false);
    gl.uniform3fv(where.shade, [0.02, 0.03, 0.03]);
    const onto = shadowOnto(TABLE_TOP_M, LIGHT);
    for (const body of bodies) this.show(body, times(onto, matrixOf(frames(body.frame))), 0.22, 1);
    gl.disable(gl.STENCIL_TEST);
  }
}

// The poses of all frames in the world, from transforms between them.
export function worldFrames(links) {
  const known = new Map([["world", NO_TURN]]);
  const find = (name) => {
    if (!known.has(name)) {
      const link = links.get(name);
      const parent = link && find(link.parent);
      known.set(name, parent ? after(parent, link.pose) : null);
    }
    return known.get(name);
  };
  return find;
}

export function steer(canvas, scene, redraw) {
  const turn = (yaw, pitch) => {
    scene.camera.yaw -= yaw;
    scene.camera.pitch = Math.min(1.56, Math.max(0.02, scene.camera.pitch + pitch));
    redraw();
  };
  const near = (factor) => {
    scene.camera.distance = Math.min(2, Math.max(0.25, scene.camera.distance * factor));
    redraw();
  };
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) turn(event.movementX / 160, event.movementY / 160);
  });
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); near(Math.exp(event.deltaY / 900)); }, { passive: false });
  const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
  canvas.addEventListener("keydown", (event) => {
    if (keys[event.key]) turn(...keys[event.key]);
    else if (event.key === "+" || event.key === "=") near(0.9);
    else if (event.key === "-") near(1 / 0.9);
    else return;
    event.preventDefault();
  });
}
