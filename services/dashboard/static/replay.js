// Replays a trial: reads what the server reduced its log to, keeps the time, and shows scene, plots and moments at it.

import { indexAt, Plot } from "./plots.js";
import { Scene, steer, VIEWS, worldFrames } from "./scene.js";
import { between } from "./vectors.js";

const element = (id) => document.getElementById(id);
const root = element("replay");

async function fetched(address) {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error((await answer.text()).replace(/<[^>]*>/g, " ").trim().slice(0, 300));
  const bytes = await answer.arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const arrays = {};
  for (const [name, { shape, at }] of Object.entries(header.arrays))
    arrays[name] = new Float32Array(bytes, 4 + length + at, shape.reduce((a, b) => a * b, 1));
  return { ...header, ...arrays };
}

const column = (rows, width, index, factor = 1) => {
  const out = new Float32Array(rows.length / width);
  for (let k = 0; k < out.length; k++) out[k] = factor * rows[k * width + index];
  return out;
};

function distances(poses, goal) {
  const out = new Float32Array(poses.length / 7);
  for (let k = 0; k < out.length; k++) out[k] = 1e3 * Math.hypot(...[0, 1, 2].map((axis) => poses[7 * k + axis] - goal[axis]));
  return out;
}

function poseAt(times, rows, time, width = 1, offset = 0) {
  const a = indexAt(times, time), b = Math.min(a + 1, times.length - 1);
  const share = b > a ? Math.min(1, Math.max(0, (time - times[a]) / (times[b] - times[a]))) : 0;
  return between(rows, 7 * (a * width + offset), 7 * (b * width + offset), share);
}

function framesAt(log, time) {
  const links = new Map(log.fixed.map(({ child, parent, pose }) => [child, { parent, pose }]));
  log.frames.forEach(([parent, child], index) =>
    links.set(child, { parent, pose: poseAt(log.frame_t_s, log.frame_pose, time, log.frames.length, index) }));
  if (log.tracked_t_s.length) {
    // A tracked pose holds until the next report: nothing is known in between.
    const k = 7 * indexAt(log.tracked_t_s, time);
    links.set("cube_tracked", { parent: "world", pose: Array.from(log.tracked_pose.subarray(k, k + 7)) });
  }
  if (log.true_t_s.length) links.set("cube", { parent: "world", pose: poseAt(log.true_t_s, log.true_pose, time) });
  return worldFrames(links);
}

// Where only the tracked pose is known, it is drawn as the object itself.
function dressed(log) {
  const known = log.true_t_s.length > 0;
  return log.entities.map((entity) => {
    if (entity.id === "cube_tracked" && !known) return { ...entity, sides: true, colour: [0.9, 0.9, 0.92, 1] };
    return entity;
  });
}

function plotsOf(log) {
  const finger = () => Number(element("finger").value);
  const joints = (name, times, factor = 1, dashed = false) => [0, 1, 2].map((joint) => ({
    t: log[times], values: column(log[name], 9, 3 * finger() + joint, factor), name: dashed ? "" : `joint ${joint}`, colour: joint, dashed,
  }));
  const axes = (poses, times, dashed) => ["x", "y", "z"].map((name, axis) => ({
    t: log[times], values: column(log[poses], 7, axis, 1e3), name: dashed ? "" : name, colour: axis, dashed,
  }));
  const [goal] = log.goal;
  const away = goal && [
    { t: log.tracked_t_s, values: distances(log.tracked_pose, goal), name: "tracked", colour: 0 },
    { t: log.true_t_s, values: distances(log.true_pose, goal), name: "true", colour: 1 },
  ];
  return [
    ...(goal ? [{ title: "Distance to the goal", unit: "mm", series: () => away, band: log.tolerance_mm }] : []),
    { title: "Object, tracked" + (log.true_t_s.length ? " and true (dashed)" : ""), unit: "mm",
      series: () => [...axes("tracked_pose", "tracked_t_s", false), ...axes("true_pose", "true_t_s", true)] },
    { title: "Joint position", unit: "rad", series: () => joints("joint_position_rad", "joint_t_s") },
    { title: "Torque applied, desired dashed", unit: "N m",
      series: () => [...joints("applied_nm", "torque_t_s"), ...joints("desired_nm", "torque_t_s", 1, true)] },
    { title: "Policy's time for an action", unit: "ms", series: () => [{ t: log.policy_t_s, values: log.inference_ms, name: "took", colour: 0 }] },
    { title: "Tracker's confidence", unit: "", series: () => [{ t: log.tracked_t_s, values: log.confidence, name: "is", colour: 0 }] },
  ];
}

function showMoments(found, duration, seek) {
  const svg = element("marks"), list = element("moments");
  for (const { t_s: at, text, kind } of found) {
    const mark = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    for (const [name, value] of Object.entries({ x: (99.4 * at) / duration, y: 0, width: 0.6, height: 10, class: kind })) mark.setAttribute(name, value);
    svg.append(mark);
    const item = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.className = `quiet moment ${kind}`;
    button.textContent = `${at.toFixed(1)} s ${text}`;
    button.addEventListener("click", () => seek(at));
    item.append(button);
    list.append(item);
  }
}

function legend(log, scene, redraw) {
  const names = { cube: "true pose", cube_tracked: log.true_t_s.length ? "tracked pose" : "tracked object", goal: "goal" };
  for (const [name, word] of Object.entries(names)) {
    if (!log.entities.some((entity) => entity.id === name)) continue;
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => { scene.hidden[box.checked ? "delete" : "add"](name); redraw(); });
    label.append(box, ` ${word}`);
    element("legend").append(label);
  }
}

async function main() {
  const log = await fetched(root.dataset.source);
  const clock = { time: 0, playing: false, last: 0 };
  let scene = null, problem = "";
  try {
    scene = new Scene(element("scene"));
    scene.load(dressed(log));
  } catch (error) {
    problem = error.message;
  }
  const slider = element("time");
  slider.max = log.duration_s;
  const seek = (time) => { clock.time = Math.min(log.duration_s, Math.max(0, time)); redraw(); };
  const plots = plotsOf(log).map((plot) => new Plot(element("plots"), plot, log.duration_s, seek));
  let asked = false;
  const redraw = () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(show);
  };
  const show = (now) => {
    asked = false;
    if (clock.playing) {
      clock.time += ((now - clock.last) / 1e3) * Number(element("speed").value);
      if (clock.time >= log.duration_s) [clock.time, clock.playing] = [log.duration_s, false];
      if (clock.playing) redraw();
    }
    clock.last = now;
    scene?.draw(framesAt(log, clock.time));
    for (const plot of plots) plot.draw(clock.time);
    slider.value = clock.time;
    slider.setAttribute("aria-valuetext", `${clock.time.toFixed(2)} seconds`);
    element("now").textContent = `${clock.time.toFixed(2)} s`;
    element("play").textContent = clock.playing ? "Pause" : "Play";
    element("play").setAttribute("aria-pressed", clock.playing);
    root.dataset.time = clock.time.toFixed(3);
  };
  const play = () => {
    if (!clock.playing && clock.time >= log.duration_s) clock.time = 0;
    [clock.playing, clock.last] = [!clock.playing, performance.now()];
    redraw();
  };
  slider.addEventListener("input", () => seek(Number(slider.value)));
  element("play").addEventListener("click", play);
  element("finger").addEventListener("change", () => { for (const plot of plots) plot.renew(); redraw(); });
  for (const button of document.querySelectorAll("[data-view]"))
    button.addEventListener("click", () => { if (scene) Object.assign(scene.camera, VIEWS[button.dataset.view]); redraw(); });
  if (scene) {
    steer(element("scene"), scene, redraw);
    legend(log, scene, redraw);
  }
  const [shown, all] = log.parts;
  element("parts").hidden = shown === all;
  element("parts").textContent = `A large log: ${shown} of its ${all} parts are shown, evenly over its time. The file itself has them all.`;
  showMoments(log.moments, log.duration_s, seek);
  const renew = () => { for (const plot of plots) plot.background = null; redraw(); };
  new ResizeObserver(renew).observe(root);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", renew);
  element("wait").textContent = problem;
  element("wait").hidden = !problem;
  redraw();
  requestAnimationFrame(() => requestAnimationFrame(() => { root.dataset.ready = "yes"; }));  // the picture is there
}

main().catch((error) => {
  element("wait").textContent = `The replay cannot be shown: ${error.message}`;
  element("wait").setAttribute("role", "alert");
});
