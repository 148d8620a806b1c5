// Poses and matrices: a pose is [x, y, z, qw, qx, qy, qz], a matrix 16 numbers column by column as WebGL wants them.

export const NO_TURN = [0, 0, 0, 1, 0, 0, 0];

export function turned(pose, [x, y, z]) {
  const [, , , w, a, b, c] = pose;
  const tx = 2 * (b * z - c * y), ty = 2 * (c * x - a * z), tz = 2 * (a * y - b * x);
  return [x + w * tx + b * tz - c * ty, y + w * ty + c * tx - a * tz, z + w * tz + a * ty - b * tx];
}

export function moved(pose, point) {
  const [x, y, z] = turned(pose, point);
  return [x + pose[0], y + pose[1], z + pose[2]];
}

export function after(parent, child) {
  const [, , , w, x, y, z] = parent, [, , , v, a, b, c] = child;
  const turn = [w * v - x * a - y * b - z * c, w * a + x * v + y * c - z * b, w * b - x * c + y * v + z * a, w * c + x * b - y * a + z * v];
  return [...moved(parent, child), ...turn];
}

// Between two poses, by the shorter way; good enough for the small turns between two samples.
export function between(rows, a, b, share) {
  let same = 0;
  for (let i = 3; i < 7; i++) same += rows[a + i] * rows[b + i];
  const sign = same < 0 ? -1 : 1;
  const pose = [];
  for (let i = 0; i < 7; i++) pose.push(rows[a + i] + share * ((i > 2 ? sign : 1) * rows[b + i] - rows[a + i]));
  const size = Math.hypot(pose[3], pose[4], pose[5], pose[6]) || 1;
  for (let i = 3; i < 7; i++) pose[i] /= size;
  return pose;
}

export function matrixOf([x, y, z, w, a, b, c]) {
  return [
    1 - 2 * (b * b + c * c), 2 * (a * b + w * c), 2 * (a * c - w * b), 0,
    2 * (a * b - w * c), 1 - 2 * (a * a + c * c), 2 * (b * c + w * a), 0,
    2 * (a * c + w * b), 2 * (b * c - w * a), 1 - 2 * (a * a + b * b), 0,
    x, y, z, 1,
  ];
}

export function times(m, n) {
  const out = new Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += m[4 * k + row] * n[4 * column + k];
      out[4 * column + row] = sum;
    }
  return out;
}

export function perspective(fieldOfView, aspect, near, far) {
  const f = 1 / Math.tan(fieldOfView / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}

export function lookAt(eye, target) {
  const back = unit(minus(eye, target)), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
  const shift = (axis) => -dot(axis, eye);
  return [
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    shift(right), shift(up), shift(back), 1,
  ];
}

// Everything falls along the light onto the plane of height z.
export function shadowOnto(height, [lx, ly, lz]) {
  return [1, 0, 0, 0, 0, 1, 0, 0, -lx / lz, -ly / lz, 0, 0, (lx / lz) * height, (ly / lz) * height, height, 1];
}

export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a) => {
  const size = Math.hypot(...a) || 1;
  return a.map((value) => value / size);
};
