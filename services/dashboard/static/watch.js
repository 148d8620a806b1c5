// Shows a running trial: the robot of the kept model, moved by what the server sends on ten times a second.

import { Scene, steer, VIEWS, worldFrames } from "./scene.js";

const element = (id) => document.getElementById(id);
const root = element("watch");
const GOAL = [0.2, 0.9, 0.3];
const SHORTEST_STAY_MS = 1000;

function entitiesOf(model) {
  const thing = model.objects[root.dataset.object], scale = Number(root.dataset.scale);
  const grown = thing.map((part) => ({ ...part, id: "cube_tracked", frame: "cube_tracked", colour: [0.9, 0.9, 0.92, 1], sides: part.kind === "cubes",
    ...(part.size ? { size: part.size.map((length) => length * scale) } : { points: part.points.map((point) => point.map((at) => at * scale)) }) }));
  return [...model.entities, ...grown];
}

// The goal is a cube, or a ball for each fingertip.
function goalOf(goal, model) {
  if (goal.length === 7) return [{ id: "goal", frame: "world", kind: "cubes", pose: goal, size: Array(3).fill(model.goal_width_m), colour: [...GOAL, 0.35] }];
  return [0, 3, 6].map((at) => ({ id: "goal", frame: "world", kind: "spheres", pose: [...goal.slice(at, at + 3), 1, 0, 0, 0],
    size: Array(3).fill(2 * model.tip_radius_m), colour: [...GOAL, 0.5] }));
}

function framesOf(state, model) {
  const links = new Map(model.fixed.map(({ child, parent, pose }) => [child, { parent, pose }]));
  model.joints.forEach(({ parent, child, origin_m, axis }, index) => {
    const half = state.joints[index] / 2;
    links.set(child, { parent, pose: [...origin_m, Math.cos(half), ...axis.map((along) => Math.sin(half) * along)] });
  });
  links.set("cube_tracked", { parent: "world", pose: state.tracked });
  return worldFrames(links);
}

async function main() {
  const model = await (await fetch("/static/trifinger.json")).json();
  const entities = entitiesOf(model);
  let scene = null, state = null, goal = "";
  try {
    scene = new Scene(element("scene"));
    scene.load(entities);
  } catch (error) {
    element("wait").textContent = error.message;
  }
  const redraw = () => { if (state) scene?.draw(framesOf(state, model)); };
  const show = () => {
    if (state.goal && String(state.goal) !== goal) {
      goal = String(state.goal);
      scene?.load([...entities, ...goalOf(state.goal, model)]);
    }
    redraw();
    const away = state.goal?.length === 7 ? `, ${(1e3 * Math.hypot(...[0, 1, 2].map((axis) => state.tracked[axis] - state.goal[axis]))).toFixed(0)} mm from the goal` : "";
    element("now").textContent = `${state.t_s.toFixed(1)} of ${state.duration_s.toFixed(0)} s${away}`;
    element("progress").max = state.duration_s;
    element("progress").value = state.t_s;
    root.dataset.seen = String(Number(root.dataset.seen ?? 0) + 1);
    root.dataset.time = String(state.t_s);
    element("wait").hidden = Boolean(scene);
  };
  const source = new EventSource(root.dataset.source);
  source.addEventListener("state", (event) => { state = JSON.parse(event.data); show(); });
  source.addEventListener("over", () => { source.close(); setTimeout(() => location.reload(), Math.max(0, SHORTEST_STAY_MS - performance.now())); });
  source.addEventListener("error", () => {
    if (source.readyState !== EventSource.CLOSED) return;
    element("wait").hidden = false;
    element("wait").textContent = "This trial cannot be watched now: too many do, or you are signed out. Load the page again in a while.";
  });
  addEventListener("pagehide", () => source.close(), { once: true });
  for (const button of document.querySelectorAll("[data-view]"))
    button.addEventListener("click", () => { if (scene) Object.assign(scene.camera, VIEWS[button.dataset.view]); redraw(); });
  if (scene) steer(element("scene"), scene, redraw);
  new ResizeObserver(redraw).observe(root);
}

main();
