// Shows a running trial: the robot of the kept model, moved by what the server sends on ten times a second.

import { entitiesOfModel, linksOfState } from "./motion.js";
import { Scene } from "./scene.js";

const element = (id) => document.getElementById(id);
const root = element("watch");
const SHORTEST_STAY_MS = 1000;

async function main() {
  const model = await (await fetch("/static/trifinger.json")).json();
  const thing = { object: root.dataset.object, scale: Number(root.dataset.scale) };
  let scene = null, state = null, goal = null;
  const redraw = () => {
    if (!state) return;
    scene?.place(linksOfState(state, model));
    scene?.draw();
  };
  try {
    scene = new Scene(element("scene"));
    scene.load(entitiesOfModel(model, thing));
    scene.steer(redraw);
  } catch (error) {
    element("wait").textContent = error.message;
  }
  const show = () => {
    if (state.goal && String(state.goal) !== String(goal)) {
      goal = state.goal;
      scene?.load(entitiesOfModel(model, thing, goal));
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
    button.addEventListener("click", () => { scene?.look(button.dataset.view); redraw(); });
  new ResizeObserver(redraw).observe(root);
}

main();
