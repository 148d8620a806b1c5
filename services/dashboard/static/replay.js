// Replays one trial, or two in one time: reads what the server reduced their logs to, and shows scene, plots and moments.

import { camerasIn } from "./cameras.js";
import { ZONED } from "./live.js";
import { entitiesOfLog, linksOfLog } from "./motion.js";
import { Plot } from "./plots.js";
import { FINGERS, Scene } from "./scene.js";
import { Quaternion } from "./three.js";

const STEP_S = 0.02;
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

const column = (rows, width, index, factor = 1) => Float32Array.from({ length: rows.length / width }, (_, k) => factor * rows[k * width + index]);
const overPoses = (poses, value) => Float32Array.from({ length: poses.length / 7 }, (_, k) => value(poses.subarray(7 * k, 7 * k + 7)));
const distances = (poses, goal) => overPoses(poses, (pose) => 1e3 * Math.hypot(...[0, 1, 2].map((axis) => pose[axis] - goal[axis])));

function angles(poses, goal) {
  const turn = ([, , , w, x, y, z]) => new Quaternion(x, y, z, w), wanted = turn(goal);
  return overPoses(poses, (pose) => (wanted.angleTo(turn(pose)) * 180) / Math.PI);
}

// How far both trials are from their goals, as far as they are known: tracked, and true where that may be seen.
function away(logs, measure) {
  return logs.flatMap((log, index) => {
    const [goal] = log.goal, whose = logs.length > 1 ? ` ${log.name}` : "";
    return goal ? [
      { t: log.tracked_t_s, values: measure(log.tracked_pose, goal), name: `tracked${whose}`, colour: index },
      { t: log.true_t_s, values: measure(log.true_pose, goal), name: `true${whose}`, colour: index, dashed: true },
    ] : [];
  });
}

function plotsOf(logs) {
  const [log] = logs, finger = () => Number(element("finger").value);
  const joints = (name, times, word, dashed = false) => [0, 1, 2].map((joint) => ({
    t: log[times], values: column(log[name], 9, 3 * finger() + joint), name: `joint ${joint}${word}`, colour: joint, dashed,
  }));
  const axes = (poses, times, word, dashed) => ["x", "y", "z"].map((name, axis) => ({
    t: log[times], values: column(log[poses], 7, axis, 1e3), name: name + word, colour: axis, dashed,
  }));
  const limits = { position: { value: log.tolerance_mm, name: `${log.tolerance_mm} mm` }, angle: { value: log.tolerance_deg, name: `${log.tolerance_deg}°` } };
  return [
    { title: "Distance to the goal", unit: "mm", series: () => away(logs, distances), limit: limits.position },
    ...(root.dataset.angle ? [{ title: "Angle to the goal", unit: "°", series: () => away(logs, angles), limit: limits.angle }] : []),
    { title: "Object", unit: "mm", series: () => [...axes("tracked_pose", "tracked_t_s", "", false), ...axes("true_pose", "true_t_s", " true", true)] },
    { title: "Joint position", unit: "rad", series: () => joints("joint_position_rad", "joint_t_s", "") },
    { title: "Torque applied, desired dashed", unit: "N m",
      series: () => [...joints("applied_nm", "torque_t_s", ""), ...joints("desired_nm", "torque_t_s", " desired", true)] },
    { title: "Policy's time for an action", unit: "ms", series: () => [{ t: log.policy_t_s, values: log.inference_ms, name: "took", colour: 0 }] },
    { title: "Tracker's confidence", unit: "", series: () => [{ t: log.tracked_t_s, values: log.confidence, name: "confidence", colour: 0 }] },
  ];
}

// On the time line and, for whoever has no pointer, in a list.
function showMoments(found, duration, seek) {
  for (const { t_s: at, text, kind } of found) {
    const mark = document.createElement("i"), item = document.createElement("li"), button = document.createElement("button");
    mark.className = `mark-at ${kind}`;
    mark.style.left = `${(100 * at) / duration}%`;
    mark.title = `${at.toFixed(1)} s ${text}`;
    mark.addEventListener("click", () => seek(at));
    button.type = "button";
    button.className = `quiet moment ${kind}`;
    button.textContent = mark.title;
    button.addEventListener("click", () => seek(at));
    element("marks").append(mark);
    item.append(button);
    element("moments").append(item);
  }
}

function legend(log, scenes, redraw) {
  const names = { cube: "true pose", cube_tracked: log.true_t_s.length ? "tracked pose" : "tracked object", goal: "goal" };
  for (const [name, word] of Object.entries(names)) {
    if (!log.entities.some((entity) => entity.id === name)) continue;
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => { for (const scene of scenes) scene.hidden[box.checked ? "delete" : "add"](name); redraw(); });
    label.append(box, ` ${word}`);
    element("legend").append(label);
  }
}

// The names of the fingers, each beside its knee.
function labelled(canvas, scene) {
  const names = Object.keys(FINGERS).map((finger) => {
    const label = document.createElement("span");
    label.className = `finger-name ${finger}`;
    label.textContent = finger.replace("finger", "finger ");
    canvas.parentElement.append(label);
    return [label, `${finger}_lower`];
  });
  return () => {
    for (const [label, frame] of names) {
      const [x, y] = scene.seenAt(frame) ?? [];
      label.hidden = x === undefined || x < 0 || y < 0 || x > canvas.clientWidth - 30 || y > canvas.clientHeight - 12;
      if (!label.hidden) label.style.transform = `translate(${x + 12}px, ${y - 8}px)`;
    }
  };
}

function stageOf(canvas, log, redraw) {
  const scene = new Scene(canvas);
  scene.load(entitiesOfLog(log));
  scene.steer(redraw);
  return { log, scene, label: labelled(canvas, scene) };
}

// Space plays, comma and point go a step, brackets a moment: anywhere but where keys are written or mean something else.
function listenToKeys({ play, seek, clock, moments }) {
  const before = () => moments.filter((each) => each.t_s < clock.time - 0.01).at(-1)?.t_s ?? 0;
  const after = () => moments.find((each) => each.t_s > clock.time + 0.01)?.t_s ?? clock.time;
  const keys = { " ": play, k: play, ",": () => seek(clock.time - STEP_S), ".": () => seek(clock.time + STEP_S), "[": () => seek(before()), "]": () => seek(after()) };
  addEventListener("keydown", (event) => {
    const busy = event.target.closest("input:not([type=range]), select, textarea, [contenteditable]") || (event.key === " " && event.target.closest("button, a, summary, .uplot"));
    if (busy || event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
}

function say(clock, time) {
  const slider = element("time");
  slider.value = time;
  slider.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds`);
  element("now").textContent = `${time.toFixed(2)} s`;
  element("play").textContent = clock.playing ? "Pause" : "Play";
  element("play").setAttribute("aria-pressed", clock.playing);
  root.dataset.time = time.toFixed(3);
  const address = new URL(location);
  address.searchParams.set("t", time.toFixed(2));
  element("here").href = address.pathname + address.search;
  if (element("share-at")) element("share-at").value = time.toFixed(2);
}

async function main() {
  const sources = [root.dataset.source, root.dataset.other].filter(Boolean);
  const logs = await Promise.all(sources.map(fetched));
  logs.forEach((log, index) => (log.name = index ? root.dataset.otherName : root.dataset.name));
  const [log] = logs, duration = Math.max(...logs.map((each) => each.duration_s));
  const clock = { time: 0, playing: false, last: 0, hovered: null };
  let asked = false;
  const redraw = () => { if (!asked) requestAnimationFrame(show); asked = true; };
  const seek = (time) => { clock.time = Math.min(duration, Math.max(0, time)); redraw(); };
  const hover = (time) => { if (time !== clock.hovered) { clock.hovered = time; redraw(); } };
  let stages = [], problem = "";
  try {
    stages = logs.map((each, index) => stageOf(element(index ? "scene-other" : "scene"), each, redraw));
  } catch (error) {
    problem = `${error.message}; the plots are complete.`;
  }
  element("time").max = duration;
  const plots = [];
  const zoomed = (from, low, high) => { for (const plot of plots) if (plot !== from) plot.show(low, high); };
  for (const plot of plotsOf(logs)) plots.push(new Plot(element("plots"), plot, { duration, seek, hover, zoomed }));
  const cameras = log.has_images && element("cameras") ? camerasIn(element("cameras"), redraw) : null;
  const show = (now) => {
    asked = false;
    if (clock.playing) {
      clock.time += ((now - clock.last) / 1e3) * Number(element("speed").value);
      if (clock.time >= duration) [clock.time, clock.playing] = [duration, false];
      if (clock.playing) redraw();
    }
    clock.last = now;
    const time = clock.playing ? clock.time : clock.hovered ?? clock.time;
    for (const { log: its, scene, label } of stages) {
      scene.place(linksOfLog(its, time));
      scene.draw();
      label();
    }
    for (const plot of plots) plot.at(clock.time);
    cameras?.at(time);
    say(clock, time);
  };
  const play = () => {
    if (!clock.playing && clock.time >= duration) clock.time = 0;
    [clock.playing, clock.last, clock.hovered] = [!clock.playing, performance.now(), null];
    redraw();
  };
  element("time").addEventListener("input", () => seek(Number(element("time").value)));
  element("play").addEventListener("click", play);
  element("finger").addEventListener("change", () => { for (const plot of plots) plot.renew(); redraw(); });
  for (const button of document.querySelectorAll("[data-view]"))
    button.addEventListener("click", () => { for (const { scene } of stages) scene.look(button.dataset.view); redraw(); });
  element("here").addEventListener("click", (event) => {
    event.preventDefault();
    history.replaceState(null, "", element("here").href);
    navigator.clipboard?.writeText(element("here").href).then(() => (element("here").textContent = "Link copied"), () => {});
  });
  listenToKeys({ play, seek, clock, moments: log.moments });
  legend(log, stages.map(({ scene }) => scene), redraw);
  const [shown, all] = log.parts;
  element("parts").hidden = shown === all;
  element("parts").textContent = `A large log: ${shown} of its ${all} parts are shown, evenly over its time. The file itself has them all.`;
  element("began").textContent = log.began_at ? `Began ${ZONED.format(new Date(log.began_at)).replace("GMT", "UTC")} by the robot's clock; times count from there.` : "";
  showMoments(log.moments, duration, seek);
  new ResizeObserver(() => { for (const plot of plots) plot.fit(); redraw(); }).observe(root);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { for (const plot of plots) plot.renew(); redraw(); });
  element("wait").textContent = problem;
  element("wait").hidden = !problem;
  seek(Number(new URLSearchParams(location.search).get("t") ?? root.dataset.at) || 0);
  requestAnimationFrame(() => requestAnimationFrame(() => { root.dataset.ready = "yes"; }));  // the picture is there
}

main().catch((error) => {
  element("wait").textContent = `The replay cannot be shown: ${error.message}`;
  element("wait").setAttribute("role", "alert");
});
