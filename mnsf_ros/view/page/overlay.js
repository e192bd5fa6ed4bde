// Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
// All over the points: boxes, labels, paths, the sensor, and the legend.

import { moved, yawOf } from "./camera.js";
import { shownColor, shownHex, theme } from "./theme.js";

const RINGS_M = [10, 20, 40, 80];
const EDGES = [[0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4],
  [0, 4], [1, 5], [2, 6], [3, 7]];
const NEAREST = 0.3;
const WHEEL_PX = 76;
const LABEL_PX = 20;

export class Overlay {
  constructor(canvas, fullSpeed) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.fullSpeed = fullSpeed;
    this.body = [];  // boxes of the own body, a lower and an upper corner each
    this.readTheme();
  }

  readTheme() {
    this.wheel = wheelImage(2 * WHEEL_PX);
  }

  // A drawing of one scene: `clipFromFrame` of the camera, `frameFromSensor`, `frameFromWorld`.
  draw(scene, view) {
    const context = this.context;
    Object.assign(this, view);
    context.setTransform(view.scale, 0, 0, view.scale, 0, 0);
    context.clearRect(0, 0, view.width, view.height);
    if (scene) {
      const objects = scene.objects.map((item) => ({ ...item, color: shownHex(item.color) }));
      this.drawRings(scene);
      this.drawPath(scene.ego.map((at) => [at[0], at[1], at[2] + scene.groundZ]), theme.ink, 1.5, 0.5);
      this.drawSensor(scene.groundZ);
      this.drawBody();
      for (const item of objects) this.drawPath(item.path, item.color, 2, 0.9);
      for (const item of objects) this.drawBox(item, item.id === view.selected.track);
      if (view.selected.at && !view.selected.track) this.drawMark(view.selected.at, scene.groundZ);
      this.drawLabels(objects, view.selected.track);
    }
    this.drawLegend(view.layer);
  }

  clip(point) {
    const m = this.clipFromFrame, [x, y, z] = point;
    return [0, 4, 12].map((row) => m[row] * x + m[row + 1] * y + m[row + 2] * z + m[row + 3]);
  }

  pixel([x, y, w]) {
    return [(1 + x / w) * this.width / 2, (1 - y / w) * this.height / 2];
  }

  // The pixels of a place in the frame of the sensor; null behind the camera.
  pixelOf(place) {
    const at = this.clip(moved(this.frameFromSensor, place));
    return at[2] > NEAREST ? this.pixel(at) : null;
  }

  // Adds a line between two places of the frame, cut where it passes the camera.
  line(from, to) {
    let [a, b] = [this.clip(from), this.clip(to)];
    if (a[2] < NEAREST && b[2] < NEAREST) return;
    const cut = (out, inside) => {
      const share = (NEAREST - out[2]) / (inside[2] - out[2]);
      return out.map((value, axis) => value + share * (inside[axis] - value));
    };
    if (a[2] < NEAREST) a = cut(a, b);
    if (b[2] < NEAREST) b = cut(b, a);
    this.context.moveTo(...this.pixel(a));
    this.context.lineTo(...this.pixel(b));
  }

  stroke(color, width, alpha, addLines) {
    const context = this.context;
    Object.assign(context, { strokeStyle: color, lineWidth: width, globalAlpha: alpha });
    context.lineCap = "round";
    context.beginPath();
    addLines();
    context.stroke();
    context.globalAlpha = 1;
  }

  // Fills a polygon of places of the frame that are all in front of the camera.
  fill(places, color, alpha) {
    const clipped = places.map((place) => this.clip(place));
    if (clipped.some(([, , depth]) => depth < NEAREST)) return;
    const context = this.context;
    context.beginPath();
    for (const place of clipped) context.lineTo(...this.pixel(place));
    Object.assign(context, { fillStyle: color, globalAlpha: alpha });
    context.fill();
    context.globalAlpha = 1;
  }

  drawRings({ groundZ }) {
    const around = (radius, turn) => moved(this.frameFromSensor,
      [radius * Math.cos(turn), radius * Math.sin(turn), groundZ]);
    for (const radius of RINGS_M) {
      this.stroke(theme.ring, 1, 0.45, () => {
        for (let k = 0; k < 72; k++)
          this.line(around(radius, k * Math.PI / 36), around(radius, (k + 1) * Math.PI / 36));
      });
      const at = this.pixelOf([0, -radius, groundZ]);
      if (at) this.text(`${radius} m`, at[0] + 4, at[1] - 4, theme.faint, "left", 11);
    }
  }

  drawPath(places, color, width, alpha) {
    const drawn = places.map((place) => moved(this.frameFromWorld, place));
    for (let k = 1; k < drawn.length; k++)
      this.stroke(color, width, alpha * (0.15 + 0.85 * k / drawn.length),
        () => this.line(drawn[k - 1], drawn[k]));
  }

  drawSensor(groundZ) {
    this.fill([[1.5, 0], [-1.1, 0.75], [-0.5, 0], [-1.1, -0.75]]
      .map(([x, y]) => moved(this.frameFromSensor, [x, y, groundZ])), theme.ink, 1);
  }

  drawMark([x, y], groundZ) {
    this.stroke(theme.ink, 2, 1, () => {
      for (const [dx, dy] of [[1, 0], [0, 1]])
        this.line(moved(this.frameFromSensor, [x - dx, y - dy, groundZ]),
          moved(this.frameFromSensor, [x + dx, y + dy, groundZ]));
    });
  }

  // In the frame of the sensor.
  corners({ center, size, yaw }) {
    const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
    const result = [];
    for (const z of [-0.5, 0.5]) for (const x of [0.5, -0.5]) for (const y of [0.5, -0.5]) {
      const [along, across] = [x * size[0], y * size[1]];
      result.push([center[0] + cos * along - sin * across, center[1] + sin * along + cos * across,
        center[2] + z * size[2]]);
    }
    return result;
  }

  placedCorners(box) {
    return this.corners(box).map((corner) => moved(this.frameFromSensor, corner));
  }

  // The boxes of the robot's own body, the first one with its name.
  drawBody() {
    this.body.forEach(([x, y, z, ...high], place) => {
      const size = [high[0] - x, high[1] - y, high[2] - z];
      const center = [x, y, z].map((low, axis) => low + size[axis] / 2);
      const corners = this.placedCorners({ center, size, yaw: 0 });
      this.context.setLineDash([2, 3]);
      this.strokeEdges(corners, theme.faint, 1, 1);
      this.context.setLineDash([]);
      const at = this.pixelOf([center[0], center[1], high[2]]);
      if (at && !place) this.text("own body", at[0], at[1] - 4, theme.faint, "center", 11);
    });
  }

  strokeEdges(corners, color, width, alpha) {
    this.stroke(color, width, alpha, () => {
      for (const [first, second] of EDGES) this.line(corners[first], corners[second]);
    });
  }

  drawBox(item, isSelected) {
    const corners = this.placedCorners(item);
    const context = this.context;
    this.fill([0, 1, 3, 2].map((k) => corners[k]), item.color,
      isSelected ? 0.4 : item.points ? 0.18 : 0.06);
    context.setLineDash(item.points ? [] : [5, 5]);
    this.strokeEdges(corners, item.color, isSelected ? 3 : 1.6, isSelected ? 1 : 0.85);
    context.setLineDash([]);
    // Where it is in a second.
    const ahead = [item.center[0] + Math.cos(item.course) * item.speed,
      item.center[1] + Math.sin(item.course) * item.speed, item.center[2] - item.size[2] / 2];
    const base = [item.center[0], item.center[1], ahead[2]];
    this.stroke(item.color, 2.5, 0.9, () =>
      this.line(moved(this.frameFromSensor, base), moved(this.frameFromSensor, ahead)));
  }

  // Labels of near objects come first; where one has no place, it is left out.
  drawLabels(objects, selected) {
    const context = this.context;
    const legend = [this.width - 110, this.bottom - 130, this.width, this.bottom];
    const placed = [legend, ...this.covered];
    const near = [...objects].sort((a, b) => (b.id === selected) - (a.id === selected)
      || Math.hypot(...a.center) - Math.hypot(...b.center));
    context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
    for (const item of near) {
      const at = this.pixelOf([item.center[0], item.center[1], item.center[2] + item.size[2] / 2]);
      if (!at || at[0] < -20 || at[0] > this.width + 20 || at[1] < 0 || at[1] > this.bottom) continue;
      const texts = [`${item.speed.toFixed(1)} m/s`,
        item.points ? `${item.age.toFixed(1)} s` : "predicted"];
      const widths = texts.map((text) => context.measureText(text).width);
      const width = widths[0] + widths[1] + 24;
      const box = this.freePlace(at, width, placed);
      if (!box) continue;
      placed.push(box);
      this.drawLabel(at, box, item.color);
      this.text(texts[0], box[0] + 9, box[1] + 14, theme.ink, "left", 12);
      this.text(texts[1], box[0] + 17 + widths[0], box[1] + 14, theme.faint, "left", 12);
    }
  }

  freePlace([x, y], width, placed) {
    for (const lift of [8, 32, 56, 80])
      for (const shift of [0, 0.6, -0.6]) {
        const left = Math.min(Math.max(4, x - width / 2 + shift * width), this.width - width - 4);
        const box = [left, y - lift - LABEL_PX, left + width, y - lift];
        const isFree = placed.every((other) => box[2] < other[0] - 3 || other[2] < box[0] - 3
          || box[3] < other[1] - 3 || other[3] < box[1] - 3);
        if (isFree && box[1] > 4) return box;
      }
    return null;
  }

  drawLabel([x, y], [left, top, right, bottom], color) {
    const context = this.context;
    this.stroke(color, 1, 0.8, () => {
      context.moveTo(Math.min(Math.max(x, left + 4), right - 4), bottom);
      context.lineTo(x, y);
    });
    context.fillStyle = theme.label;
    context.beginPath();
    context.roundRect(left, top, right - left, LABEL_PX, 5);
    context.fill();
    context.fillStyle = color;
    context.fillRect(left, top + 4, 3, LABEL_PX - 8);
  }

  drawLegend(layer) {
    const context = this.context, half = WHEEL_PX / 2;
    const [x, y] = [this.width - half - 30, this.bottom - half - 40];
    if (layer === "error") {
      const ramp = context.createLinearGradient(x - 60, 0, x + half, 0);
      [theme.ring, "#e2b02c", "#ff3a28"].forEach((color, k) => ramp.addColorStop(k / 2, color));
      context.fillStyle = ramp;
      context.fillRect(x - 60, y + 30, half + 60, 8);
      this.text("error of the flow, 0 to 0.3 m", x + half, y + 56, theme.faint, "right", 11);
      return;
    }
    const turn = this.azimuth - yawOf(this.frameFromSensor);
    context.save();
    context.translate(x, y);
    context.rotate(turn - Math.PI / 2);
    context.drawImage(this.wheel, -half, -half, WHEEL_PX, WHEEL_PX);
    context.restore();
    const away = half + 11;
    this.text("ahead", x + Math.sin(turn) * away, y - Math.cos(turn) * away + 4, theme.faint, "center", 11);
    this.text(`full colour ${this.fullSpeed} m/s`, x + half, y + half + 28, theme.faint, "right", 11);
  }

  text(text, x, y, color, align, size) {
    const context = this.context;
    context.font = `${size}px system-ui, "DejaVu Sans", sans-serif`;
    Object.assign(context, { textAlign: align, lineWidth: 3, strokeStyle: theme.ground });
    context.lineJoin = "round";
    context.strokeText(text, x, y);
    context.fillStyle = color;
    context.fillText(text, x, y);
  }
}

// Ahead, x, is to the right and left, y, is up; as in drawing/color_wheel.py.
function wheelImage(size) {
  const canvas = new OffscreenCanvas(size, size), context = canvas.getContext("2d");
  const image = context.createImageData(size, size);
  for (let row = 0; row < size; row++)
    for (let column = 0; column < size; column++) {
      const [x, y] = [(column + 0.5) / size * 2 - 1, 1 - (row + 0.5) / size * 2];
      const radius = Math.hypot(x, y), strength = Math.sqrt(Math.min(1, radius));
      const sixths = Math.atan2(y, x) * 3 / Math.PI;
      const rgb = [0, 2, 4].map((peak, channel) => {
        const off = Math.abs(((sixths - peak + 3) % 6 + 6) % 6 - 3);
        const neutral = [0.36, 0.38, 0.42][channel];
        return 255 * (neutral + strength * (Math.min(1, Math.max(0, 2 - off)) - neutral));
      });
      const alpha = 255 * Math.min(1, Math.max(0, (1 - radius) * size / 2));
      image.data.set([...shownColor(rgb), alpha], 4 * (row * size + column));
    }
  context.putImageData(image, 0, 0);
  return canvas;
}
