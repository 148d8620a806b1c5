// Draws the small pictures of a job's trials: each once, as a strip of its few poses, and then in a loop.

const FRAME_MS = 260;
const NEAR = [0.05, -0.42, 0.5];
const REST_FRAMES = 4;
const root = document.getElementById("sheet");
const strips = new Map();
let drawing = null;

const wanted = () => [...root.querySelectorAll("canvas[data-trial]")];

async function drawn() {
  const missing = wanted().filter(({ dataset }) => !strips.has(dataset.trial));
  if (!missing.length) return;
  for (const { dataset } of missing) strips.set(dataset.trial, null);
  const [{ entitiesOfModel, linksOfState }, { Scene }, model, found] = await Promise.all([
    import("./motion.js"), import("./scene.js"), fetch("/static/trifinger.json").then((answer) => answer.json()),
    fetch(root.dataset.source).then((answer) => (answer.ok ? answer.json() : {})),
  ]);
  const { width, height } = missing[0], canvas = Object.assign(document.createElement("canvas"), { width, height });
  const scene = new Scene(canvas, { scale: 1 }), camera = scene.camera, thing = { object: root.dataset.object, scale: Number(root.dataset.scale) };
  scene.renderer.shadowMap.enabled = false;
  camera.position.set(...NEAR);
  camera.lookAt(0, 0, 0.03);
  for (const { dataset } of missing) {
    const glimpse = found[dataset.trial];
    if (!glimpse) continue;
    scene.load(entitiesOfModel(model, thing, glimpse.goal));
    const frames = glimpse.t_s.length, strip = Object.assign(document.createElement("canvas"), { width: width * frames, height });
    const context = strip.getContext("2d");
    for (let k = 0; k < frames; k++) {
      scene.place(linksOfState({ joints: glimpse.joint_position_rad[k], tracked: glimpse.tracked_pose[k] }, model));
      scene.draw();
      context.drawImage(canvas, k * width, 0);
    }
    strips.set(dataset.trial, strip);
    step(wanted());
    await new Promise((done) => setTimeout(done));  // the page stays at hand
  }
  scene.renderer.dispose();
  scene.renderer.forceContextLoss();
  root.dataset.drawn = String([...strips.values()].filter(Boolean).length);
}

let beat = 0;

function step(canvases) {
  for (const canvas of canvases) {
    const strip = strips.get(canvas.dataset.trial);
    if (!strip) continue;
    const { width, height } = canvas, frames = strip.width / width, frame = Math.min(frames - 1, beat % (frames + REST_FRAMES));
    if (canvas.dataset.frame === String(frame)) continue;
    canvas.dataset.frame = frame;
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, width, height);
    context.drawImage(strip, frame * width, 0, width, height, 0, 0, width, height);
  }
}

function renew() {
  drawing = (drawing ?? Promise.resolve()).then(drawn).catch((error) => (root.dataset.problem = error.message));
}

if (root) {
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) beat = 1e9 - (1e9 % 14) - 1;
  else setInterval(() => { if (!document.hidden) { beat += 1; step(wanted()); } }, FRAME_MS);
  new MutationObserver(renew).observe(root, { childList: true, subtree: true });
  // The page is there first.
  requestAnimationFrame(() => setTimeout(renew));
}
