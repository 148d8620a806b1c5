// Where the frames of a scene are: at a time of a log, or in a state that a robot shows of itself.

import { Quaternion, Vector3 } from "./three.js";

const GOAL = [0.2, 0.9, 0.3];

// The last sample at or before a time.
export function indexAt(t, time) {
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}

function between(rows, a, b, share) {
  const [from, to] = [a, b].map((at) => new Quaternion(rows[at + 4], rows[at + 5], rows[at + 6], rows[at + 3]));
  const turn = from.slerp(to, share), place = new Vector3().fromArray(rows, a).lerp(new Vector3().fromArray(rows, b), share);
  return [...place, turn.w, turn.x, turn.y, turn.z];
}

function poseAt(times, rows, time, width = 1, offset = 0) {
  const a = indexAt(times, time), b = Math.min(a + 1, times.length - 1);
  const share = b > a ? Math.min(1, Math.max(0, (time - times[a]) / (times[b] - times[a]))) : 0;
  return between(rows, 7 * (a * width + offset), 7 * (b * width + offset), share);
}

export function linksOfLog(log, time) {
  const links = log.fixed.map(({ child, parent, pose }) => [child, parent, pose]);
  log.frames.forEach(([parent, child], index) =>
    links.push([child, parent, poseAt(log.frame_t_s, log.frame_pose, time, log.frames.length, index)]));
  if (log.tracked_t_s.length) {
    // A tracked pose holds until the next report: nothing is known in between.
    const k = 7 * indexAt(log.tracked_t_s, time);
    links.push(["cube_tracked", "world", Array.from(log.tracked_pose.subarray(k, k + 7))]);
  }
  if (log.true_t_s.length) links.push(["cube", "world", poseAt(log.true_t_s, log.true_pose, time)]);
  return links;
}

// Where only the tracked pose is known, it is drawn as the object itself.
export function entitiesOfLog(log) {
  const known = log.true_t_s.length > 0;
  return log.entities.map((entity) =>
    entity.id === "cube_tracked" && !known ? { ...entity, sides: entity.kind === "cubes", colour: [0.9, 0.9, 0.92, 1] } : entity);
}

// ``joints`` are nine angles in rad, ``tracked`` is a pose.
export function linksOfState({ joints, tracked }, model) {
  const links = model.fixed.map(({ child, parent, pose }) => [child, parent, pose]);
  model.joints.forEach(({ parent, child, origin_m, axis }, index) => {
    const half = joints[index] / 2;
    links.push([child, parent, [...origin_m, Math.cos(half), ...axis.map((along) => Math.sin(half) * along)]]);
  });
  return [...links, ["cube_tracked", "world", tracked]];
}

export function entitiesOfModel(model, { object, scale }, goal) {
  const parts = model.objects[object].map((part) => ({
    ...part, id: "cube_tracked", frame: "cube_tracked", colour: [0.9, 0.9, 0.92, 1], sides: part.kind === "cubes",
    ...(part.size ? { size: part.size.map((length) => length * scale) } : { points: part.points.map((point) => point.map((at) => at * scale)) }),
  }));
  return [...model.entities, ...parts, ...(goal ? goalOf(goal, model) : [])];
}

// The goal is a cube, or a ball for each fingertip.
function goalOf(goal, model) {
  if (goal.length === 7) return [{ id: "goal", frame: "world", kind: "cubes", pose: goal, size: Array(3).fill(model.goal_width_m), colour: [...GOAL, 0.35] }];
  return [0, 3, 6].map((at) => ({ id: "goal", frame: "world", kind: "spheres", pose: [...goal.slice(at, at + 3), 1, 0, 0, 0],
    size: Array(3).fill(2 * model.tip_radius_m), colour: [...GOAL, 0.5] }));
}
