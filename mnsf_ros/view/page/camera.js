// Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
// A camera that orbits a target. Frames have z up; matrices are 16 numbers in rows.

export const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

const NEAR_M = 0.3;
const FAR_M = 2000;
const FIELD_OF_VIEW = 0.8;
const HIGHEST = 1.5607;  // a little less than straight down

export function product(a, b) {
  const result = new Array(16).fill(0);
  for (let row = 0; row < 4; row++)
    for (let column = 0; column < 4; column++)
      for (let k = 0; k < 4; k++) result[4 * row + column] += a[4 * row + k] * b[4 * k + column];
  return result;
}

export function moved(matrix, [x, y, z]) {
  return [0, 4, 8].map((row) =>
    matrix[row] * x + matrix[row + 1] * y + matrix[row + 2] * z + matrix[row + 3]);
}

// The inverse of a rotation with a translation.
export function inverse(m) {
  const turned = [m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0, 0, 0, 0, 1];
  const [x, y, z] = moved(turned, [m[3], m[7], m[11]]);
  return Object.assign(turned, { 3: -x, 7: -y, 11: -z });
}

export const yawOf = (matrix) => Math.atan2(matrix[4], matrix[0]);

export class Camera {
  target = [8, 0, 0];
  distance = 38;
  azimuth = 0;  // direction of the view about z, from x
  elevation = 0.55;

  lookFromBehind() {
    Object.assign(this, { distance: 38, elevation: 0.55 });
  }

  lookFromAbove() {
    Object.assign(this, { distance: 90, elevation: HIGHEST });
  }

  get isAbove() {
    return this.elevation === HIGHEST;
  }

  orbit(dx, dy) {
    this.azimuth -= 0.006 * dx;
    this.elevation = Math.min(HIGHEST, Math.max(0.03, this.elevation + 0.006 * dy));
  }

  pan(dx, dy, height) {
    const metres = this.distance * FIELD_OF_VIEW / height;
    const [cos, sin] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const ahead = dy * metres / Math.max(0.25, Math.sin(this.elevation));
    this.target[0] += cos * ahead + sin * dx * metres;
    this.target[1] += sin * ahead - cos * dx * metres;
  }

  zoom(steps) {
    this.distance = Math.min(600, Math.max(2, this.distance * Math.exp(steps)));
  }

  // Keeps the view when the frame that it is in changes.
  changeFrame(newFromOld) {
    this.target = moved(newFromOld, this.target);
    this.azimuth += yawOf(newFromOld);
  }

  clipFromFrame(aspect) {
    const [ca, sa] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const [ce, se] = [Math.cos(this.elevation), Math.sin(this.elevation)];
    const [right, up, ahead] = [[sa, -ca, 0], [ca * se, sa * se, ce], [ca * ce, sa * ce, -se]];
    const eye = this.target.map((value, axis) => value - this.distance * ahead[axis]);
    const row = (axis, sign) => [...axis.map((value) => sign * value),
      -sign * (axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2])];
    const view = [...row(right, 1), ...row(up, 1), ...row(ahead, -1), 0, 0, 0, 1];
    const focal = 1 / Math.tan(FIELD_OF_VIEW / 2);
    const depth = 1 / (NEAR_M - FAR_M);
    const projection = [focal / aspect, 0, 0, 0, 0, focal, 0, 0, 0, 0, (FAR_M + NEAR_M) * depth,
      2 * FAR_M * NEAR_M * depth, 0, 0, -1, 0];
    return product(projection, view);
  }
}
