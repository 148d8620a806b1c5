// The scene of a trial, drawn by three.js: bodies hang in frames, what is translucent comes last, and nothing hides the object.

import {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DirectionalLight, Group,
  HemisphereLight, mergeGeometries, Mesh, MeshLambertMaterial, NotEqualStencilFunc, OrbitControls, PCFShadowMap, PerspectiveCamera,
  Raycaster, ReplaceStencilOp, Scene as World, SphereGeometry, SRGBColorSpace, Vector3, WebGLRenderer,
} from "./three.js";

const TARGET = new Vector3(0, 0, 0.07);
// The eye from the target, in m: the corner looks through the gap between two fingers.
export const VIEWS = { corner: [0.09, -0.7, 0.62], front: [0, -0.85, 0.17], side: [0.85, 0, 0.17], top: [0, -0.02, 0.85] };
// The sides of the cube: +x red, -x magenta, +y green, -y yellow, +z blue, -z cyan, in the order of three's box.
const SIDES = [[0.83, 0.2, 0.2], [0.75, 0.25, 0.65], [0.2, 0.62, 0.3], [0.9, 0.78, 0.2], [0.2, 0.35, 0.8], [0.15, 0.68, 0.75]];
export const FINGERS = { finger0: [0.16, 0.62, 0.58], finger120: [0.85, 0.45, 0.16], finger240: [0.48, 0.42, 0.86] };
const OBJECTS = ["cube", "cube_tracked"];
const FADED = 0.22;
const BESIDE_M = 0.024;
const TURN_RAD = 0.1;

const lengthwise = (geometry) => geometry.rotateX(Math.PI / 2);
const SHAPES = {
  cubes: ({ size }) => new BoxGeometry(...size),
  spheres: ({ size }) => new SphereGeometry(size[0] / 2, 32, 20),
  cylinders: ({ size, frame }) => lengthwise(frame === "world"
    ? new CylinderGeometry(size[0] / 2, size[0] / 2, size[2], 64) : new CapsuleGeometry(size[0] / 2, size[2], 8, 32)),
  triangles: ({ points, indices }) => new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(points.flat()), 3)).setIndex(indices),
};

// A primitive in its entity's frame, with a colour for each corner.
function geometryOf(entity) {
  let geometry = SHAPES[entity.kind](entity);
  if (geometry.index) geometry = geometry.toNonIndexed();
  if (!geometry.attributes.normal) geometry.computeVertexNormals();
  geometry.deleteAttribute("uv");
  const count = geometry.attributes.position.count, colours = new Float32Array(3 * count), colour = new Color();
  for (let k = 0; k < count; k++)
    colour.setRGB(...(entity.sides ? SIDES[Math.floor((6 * k) / count)] : entity.colour.slice(0, 3)), SRGBColorSpace).toArray(colours, 3 * k);
  geometry.setAttribute("color", new BufferAttribute(colours, 3));
  return geometry.applyMatrix4(posed(new Group(), entity.pose).matrix);
}

function posed(group, [x, y, z, qw, qx, qy, qz]) {
  group.position.set(x, y, z);
  group.quaternion.set(qx, qy, qz, qw);
  group.updateMatrix();
  return group;
}

// Each place shows one layer of a translucent body, so that the seams of its parts do not show.
function materialOf(opacity, layer) {
  if (opacity >= 0.99) return new MeshLambertMaterial({ vertexColors: true });
  const single = { stencilWrite: true, stencilRef: layer, stencilFunc: NotEqualStencilFunc, stencilZPass: ReplaceStencilOp };
  return new MeshLambertMaterial({ vertexColors: true, transparent: true, opacity, depthWrite: false, ...single });
}

export class Scene {
  constructor(canvas, { scale = Math.min(devicePixelRatio || 1, 2) } = {}) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, stencil: true });
    this.renderer.setPixelRatio(scale);
    Object.assign(this.renderer.shadowMap, { enabled: true, type: PCFShadowMap });
    this.world = new World();
    this.camera = new PerspectiveCamera(39, 1, 0.05, 5);
    this.camera.up.set(0, 0, 1);
    this.ray = new Raycaster();
    this.hidden = new Set();
    this.light();
    this.look("corner");
    this.load([]);
  }

  light() {
    const sun = new DirectionalLight(0xffffff, 1.9);
    sun.position.set(0.35, -0.25, 0.9);
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    Object.assign(sun.shadow.camera, { left: -0.32, right: 0.32, top: 0.32, bottom: -0.32, near: 0.3, far: 1.6 });
    sun.shadow.normalBias = 0.002;
    this.world.add(sun, new AmbientLight(0xffffff, 0.75), new HemisphereLight(0xffffff, 0x555560, 1.1));
  }

  // Entities of one frame, name and opacity become one body; ``frames`` are placed anew afterwards.
  load(entities) {
    for (const body of this.bodies ?? []) body.geometry.dispose();
    for (const frame of this.frames?.values() ?? []) frame.removeFromParent();
    this.frames = new Map([["world", new Group()]]);
    this.world.add(this.frames.get("world"));
    const groups = new Map();
    for (const entity of entities.map(coloured)) {
      const key = `${entity.frame} ${entity.id} ${entity.colour[3]}`;
      groups.set(key, [...(groups.get(key) ?? []), entity]);
    }
    this.bodies = [...groups.values()].map((members, index) => {
      const [{ id, frame, colour }] = members;
      const body = new Mesh(mergeGeometries(members.map(geometryOf)), materialOf(colour[3], index + 1));
      Object.assign(body, { name: id, castShadow: colour[3] >= 0.99 && frame !== "world", receiveShadow: id === "arena" && colour[3] >= 0.99 });
      this.frame(frame).add(body);
      return body;
    });
    this.fingers = this.bodies.filter((body) => body.name.startsWith("finger"));
  }

  frame(name) {
    if (!this.frames.has(name)) this.frames.set(name, new Group());
    return this.frames.get(name);
  }

  // ``links``: [child, parent, pose] for each frame that is to be somewhere.
  place(links) {
    for (const [child, parent, pose] of links) {
      const group = posed(this.frame(child), pose);
      if (group.parent !== this.frame(parent)) this.frame(parent).add(group);
    }
  }

  look(view) {
    this.camera.position.fromArray(VIEWS[view]).add(TARGET);
    this.camera.lookAt(TARGET);
    this.controls?.update();
  }

  draw() {
    const { canvas, camera, renderer } = this, width = canvas.clientWidth || canvas.width, height = canvas.clientHeight || canvas.height;
    const size = `${width} ${height}`;
    if (this.size !== size) {
      this.size = size;
      renderer.setSize(width, height, false);
      camera.aspect = width / Math.max(1, height);
      camera.fov = camera.aspect < 1 ? 54 : 39;
      camera.updateProjectionMatrix();
    }
    for (const body of this.bodies) body.visible = !this.hidden.has(body.name);
    this.world.updateMatrixWorld();
    this.clear();
    renderer.render(this.world, camera);
  }

  // Makes translucent what stands between the eye and the object.
  clear() {
    const object = OBJECTS.map((name) => this.frames.get(name)).find((frame) => frame?.parent);
    const blocking = new Set();
    if (object) {
      const { camera, ray } = this, middle = object.getWorldPosition(new Vector3());
      const right = new Vector3().setFromMatrixColumn(camera.matrixWorld, 0), up = new Vector3().setFromMatrixColumn(camera.matrixWorld, 1);
      for (const [across, along] of [[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]]) {
        const to = middle.clone().addScaledVector(right, across * BESIDE_M).addScaledVector(up, along * BESIDE_M).sub(camera.position);
        ray.far = to.length() - BESIDE_M;
        ray.set(camera.position, to.normalize());
        for (const { object: body } of ray.intersectObjects(this.fingers, false)) blocking.add(body);
      }
    }
    for (const body of this.fingers)
      Object.assign(body.material, blocking.has(body) ? { transparent: true, opacity: FADED } : { transparent: false, opacity: 1 });
  }

  // Where on the canvas a frame is, in CSS pixels.
  seenAt(name) {
    const at = this.frames.get(name)?.getWorldPosition(new Vector3()).project(this.camera);
    return at && [((at.x + 1) / 2) * this.canvas.clientWidth, ((1 - at.y) / 2) * this.canvas.clientHeight];
  }

  // Pointer, wheel, and the arrow keys of the canvas turn the view.
  steer(redraw) {
    this.controls = new OrbitControls(this.camera, this.canvas);
    Object.assign(this.controls, { enablePan: false, minDistance: 0.2, maxDistance: 2, maxPolarAngle: 1.55, rotateSpeed: 0.8 });
    this.controls.target.copy(TARGET);
    this.controls.update();
    this.controls.addEventListener("change", redraw);
    const keys = { ArrowLeft: [-1, 0, 1], ArrowRight: [1, 0, 1], ArrowUp: [0, 1, 1], ArrowDown: [0, -1, 1], "+": [0, 0, 0.9], "=": [0, 0, 0.9], "-": [0, 0, 1 / 0.9] };
    this.canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      event.stopPropagation();
      const [across, up, factor] = keys[event.key], from = this.camera.position.clone().sub(TARGET);
      from.applyAxisAngle(this.camera.up, across * TURN_RAD).multiplyScalar(factor);
      from.z = Math.max(0.01, from.z + up * TURN_RAD * from.length());
      this.camera.position.copy(from.add(TARGET));
      this.controls.update();
      redraw();
    });
  }
}

// Fingers are told apart by their colour.
function coloured(entity) {
  const tint = FINGERS[entity.id.split("_")[0]];
  if (!tint) return entity;
  const share = entity.id.endsWith("_tip") ? 1 : 0.72;
  return { ...entity, colour: [...tint.map((value, k) => share * value + (1 - share) * entity.colour[k]), entity.colour[3]] };
}
