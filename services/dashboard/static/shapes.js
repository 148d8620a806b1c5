// The primitives of a scene as triangles: rows of position, normal and colour in the frame of their entity.

import { cross, minus, moved, turned, unit } from "./vectors.js";

const AROUND = 48;
// The sides of the cube have colours of their own: +x red, +y green, +z blue, -z cyan, -x magenta, -y yellow.
export const SIDES = [[0.83, 0.2, 0.2], [0.2, 0.62, 0.3], [0.2, 0.35, 0.8], [0.15, 0.68, 0.75], [0.75, 0.25, 0.65], [0.9, 0.78, 0.2]];

export function triangles(entity, colour) {
  const rows = [];
  const put = (point, normal, tint = colour) => rows.push(...moved(entity.pose, point), ...turned(entity.pose, normal), ...tint);
  const make = { cubes: box, spheres: ball, cylinders: entity.frame === "world" ? disc : capsule, triangles: given }[entity.kind];
  make(entity, put);
  return rows;
}

function box({ size, sides }, put) {
  const half = size.map((length) => length / 2);
  [[0, 1], [1, 1], [2, 1], [2, -1], [0, -1], [1, -1]].forEach(([axis, sign], side) => {
    const normal = [0, 0, 0];
    normal[axis] = sign;
    const [u, v] = [0, 1, 2].filter((other) => other !== axis);
    const corner = (a, b) => {
      const point = [0, 0, 0];
      [point[axis], point[u], point[v]] = [sign * half[axis], a * half[u], b * half[v]];
      return point;
    };
    const quad = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
    for (const k of [0, 1, 2, 0, 2, 3]) put(quad[k], normal, sides ? SIDES[side] : undefined);
  });
}

// A surface of turned rings: each ring has a height, a radius, and the slope of its normal along the axis.
function lathe(rings, put) {
  const at = (ring, k) => {
    const angle = (2 * Math.PI * k) / AROUND, [height, radius, slope] = ring;
    const flat = Math.sqrt(Math.max(0, 1 - slope * slope));
    return [[radius * Math.cos(angle), radius * Math.sin(angle), height], [flat * Math.cos(angle), flat * Math.sin(angle), slope]];
  };
  for (let r = 0; r + 1 < rings.length; r++)
    for (let k = 0; k < AROUND; k++) {
      const [a, b, c, d] = [at(rings[r], k), at(rings[r], k + 1), at(rings[r + 1], k + 1), at(rings[r + 1], k)];
      for (const [point, normal] of [a, b, c, a, c, d]) put(point, normal);
    }
}

function cap(rings, radius, middle, from, to, steps = 8) {
  for (let k = 0; k <= steps; k++) {
    const angle = from + ((to - from) * k) / steps;
    rings.push([middle + radius * Math.sin(angle), radius * Math.cos(angle), Math.sin(angle)]);
  }
}

function ball({ size }, put) {
  const rings = [];
  cap(rings, size[0] / 2, 0, -Math.PI / 2, Math.PI / 2, 14);
  lathe(rings, put);
}

function capsule({ size }, put) {
  const rings = [], radius = size[0] / 2;
  cap(rings, radius, -size[2] / 2, -Math.PI / 2, 0);
  cap(rings, radius, size[2] / 2, 0, Math.PI / 2);
  lathe(rings, put);
}

function disc({ size }, put) {
  const radius = size[0] / 2, half = size[2] / 2;
  lathe([[half, radius, 1], [half, 0, 1]], put);
  lathe([[-half, radius, 0], [half, radius, 0]], put);
}

function given({ points, indices }, put) {
  for (let k = 0; k < indices.length; k += 3) {
    const [a, b, c] = [0, 1, 2].map((step) => points[indices[k + step]]);
    const normal = unit(cross(minus(b, a), minus(c, a)));
    for (const point of [a, b, c]) put(point, normal);
  }
}
