// Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
// The page of `mnsf view`: scenes come through a WebSocket, commands go back.

import { Camera, IDENTITY, inverse, moved, product } from "./camera.js";
import { Overlay } from "./overlay.js";
import { element, Knobs, Player, showSelection, showValues, Status } from "./panel.js";
import { Points } from "./points.js";
import { followSystem } from "./theme.js";

const FULL_SPEED_M_S = 5;
const RETRY_MS = 1000;
const PICK_PX = 12;
const CLICK_PX = 4;

const find = (selector) => document.querySelector(selector);
const canvas = find("#overlay");
const camera = new Camera();
const points = new Points(find("#points"));
const overlay = new Overlay(canvas, FULL_SPEED_M_S);

let socket = null;
let scene = null;
let layer = "estimate";
let follows = true;
let selected = { track: 0, at: null, lines: [] };
let isDrawn = true;

const send = (command) => {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
};
const player = new Player(send), knobs = new Knobs(send), status = new Status();

// --- messages

const HANDLERS = {
  title({ text }) {
    find("#title").textContent = document.title = text;
  },
  player(message) {
    player.show(message);
    layer = message.layer;
    showLayers(message.layers);
    draw();
  },
  knobs(message) {
    knobs.show(message);
    overlay.body = message.body;
    draw();
  },
  waiting: ({ text }) => { find("#waiting").textContent = text; },
  status(message) {
    status.show(message);
    Object.assign(find("#lost"), { hidden: !message.lost,
      textContent: `Ego motion lost: ${message.lost}. Nothing counts as moving.` });
  },
  refused: ({ text }) => notice(text, 6000),
  reasons({ lines, track }) {
    if (track !== selected.track) return;
    selected.lines = lines;
    describeSelection();
  },
};

function connect() {
  const opened = new WebSocket(`ws://${location.host}/socket${location.search}`);
  socket = opened;
  opened.binaryType = "arraybuffer";
  opened.onopen = () => notice("");
  opened.onmessage = ({ data }) => {
    if (typeof data !== "string") return showScene(data);
    const message = JSON.parse(data);
    HANDLERS[message.kind]?.(message);
  };
  opened.onclose = ({ reason }) => {
    if (socket !== opened) return;
    socket = null;
    notice(`no connection${reason ? `: ${reason}` : ""}`);
    setTimeout(() => { if (!socket && !document.hidden) connect(); }, RETRY_MS);
  };
}

// Nothing is sent to a page that nobody sees.
document.onvisibilitychange = () => {
  if (!document.hidden && !socket) connect();
  if (document.hidden && socket) {
    const closed = socket;
    socket = null;
    closed.close();
  }
};

function showScene(data) {
  const length = new DataView(data).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const start = 4 + length, count = head.numPoints;
  const xyz = new Float32Array(data, start, 3 * count);
  scene = { ...head, xyz, groundZ: groundOf(xyz, scene?.groundZ) };
  find("#waiting").hidden = true;
  points.show(xyz, new Uint32Array(data, start + 12 * count, count));
  find("#stamp").textContent = `${head.stamp} s`;
  const item = scene.objects.find(({ id }) => id === selected.track);
  if (item) selected.at = item.center.slice(0, 2);
  describeSelection();
  draw();
}

// The height of the ground around the sensor, below most points.
function groundOf(xyz, before) {
  const heights = [];
  for (let k = 0; k < xyz.length; k += 3 * 23)
    if (Math.hypot(xyz[k], xyz[k + 1]) < 15) heights.push(xyz[k + 2]);
  if (heights.length < 20) return before ?? -1.7;
  heights.sort((a, b) => a - b);
  const now = heights[Math.floor(heights.length * 0.1)];
  return before === undefined ? now : 0.9 * before + 0.1 * now;
}

// --- drawing

function draw() {
  if (!isDrawn) return;
  isDrawn = false;
  requestAnimationFrame(() => {
    isDrawn = true;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const scale = devicePixelRatio;
    for (const one of [canvas, find("#points")])
      if (one.width !== Math.round(width * scale) || one.height !== Math.round(height * scale))
        Object.assign(one, { width: Math.round(width * scale), height: Math.round(height * scale) });
    const frameFromSensor = follows ? IDENTITY : scene?.pose ?? IDENTITY;
    const frameFromWorld = follows ? inverse(scene?.pose ?? IDENTITY) : IDENTITY;
    const clipFromFrame = camera.clipFromFrame(width / height);
    points.draw(product(clipFromFrame, frameFromSensor), camera.distance);
    const bottom = find("#player").hidden ? height : find("#player").getBoundingClientRect().top;
    const covered = [...document.querySelectorAll("header, nav, #lost, #words")].map((one) => {
      const { left, top, right, bottom } = one.getBoundingClientRect();
      return [left, top, right, bottom];
    });
    overlay.draw(scene, { clipFromFrame, frameFromSensor, frameFromWorld, width, height, bottom,
      covered, scale, selected, layer, azimuth: camera.azimuth });
    for (const [name, isOn] of [["top", camera.isAbove], ["orbit", !camera.isAbove],
      ["follow", follows], ["fold", !document.body.classList.contains("folded")]])
      find(`#${name}`).classList.toggle("on", isOn);
    Object.assign(document.body.dataset, { stamp: scene?.stamp ?? "", layer });
  });
}

function notice(text, durationMs = 0) {
  const box = find("#notice");
  Object.assign(box, { textContent: text, hidden: !text });
  if (durationMs) setTimeout(() => { if (box.textContent === text) notice(""); }, durationMs);
}

function showLayers(names) {
  const box = find("#layers");
  if (box.childElementCount !== names.length)
    box.replaceChildren(...names.map((name) => element("button",
      { textContent: name, onclick: () => send({ do: "layer", name }) })));
  box.hidden = names.length < 2;
  for (const button of box.children) button.classList.toggle("on", button.textContent === layer);
}

function setFollowing(isOn) {
  if (scene && isOn !== follows) camera.changeFrame(isOn ? inverse(scene.pose) : scene.pose);
  follows = isOn;
  draw();
}

function setFolded(isFolded) {
  document.body.classList.toggle("folded", isFolded);
  draw();
}

function look(from) {
  camera[from]();
  const place = follows ? [8, 0, 0] : moved(scene?.pose ?? IDENTITY, [8, 0, 0]);
  camera.target = place;
  draw();
}

// --- selection

function describeSelection() {
  const item = scene?.objects.find(({ id }) => id === selected.track);
  const at = selected.at?.map((value) => value.toFixed(1)).join(", ");
  const values = item && {
    "speed": `${item.speed.toFixed(2)} m/s`,
    "seen moving for": `${item.age.toFixed(1)} s`,
    "length, width, height": `${item.size.map((value) => value.toFixed(1)).join(" × ")} m`,
    "points": item.points || "hidden: predicted",
  };
  const title = selected.track ? `Object ${selected.track}${item ? "" : ", last"}` : "Place";
  showSelection(selected.at ? `${title} at (${at}) m` : "", values ?? {}, selected.lines);
}

function select(track, at) {
  selected = { track, at, lines: [] };
  send(at ? { do: "explain", at, track } : { do: "forget" });
  if (at) setFolded(false);
  describeSelection();
  draw();
}

// Objects one after the other, the nearest first, then none.
function selectNext() {
  const near = [...(scene?.objects ?? [])].sort((a, b) =>
    Math.hypot(...a.center) - Math.hypot(...b.center));
  const item = near[near.findIndex(({ id }) => id === selected.track) + 1];
  select(item?.id ?? 0, item?.center.slice(0, 2) ?? null);
}

function pick(x, y) {
  if (!scene) return;
  let best = { distance: PICK_PX, track: 0, at: null };
  const consider = (place, track, slack) => {
    const pixel = overlay.pixelOf(place);
    if (!pixel) return;
    const distance = Math.hypot(pixel[0] - x, pixel[1] - y) - slack;
    if (distance < best.distance) best = { distance, track, at: [place[0], place[1]] };
  };
  for (const item of scene.objects) consider(item.center, item.id, 10);
  for (const item of scene.objects)
    for (const corner of overlay.corners(item)) consider(corner, item.id, 0);
  if (!best.track)
    for (let k = 0; k < scene.xyz.length; k += 3)
      consider([scene.xyz[k], scene.xyz[k + 1], scene.xyz[k + 2]], 0, 0);
  const item = scene.objects.find(({ id }) => id === best.track);
  select(best.track, item ? item.center.slice(0, 2) : best.at);
}

// --- mouse and keys

let drag = null;
canvas.onpointerdown = (event) => {
  canvas.setPointerCapture(event.pointerId);
  drag = { x: event.clientX, y: event.clientY, travel: 0,
    pans: event.button !== 0 || event.shiftKey };
};
canvas.onpointermove = (event) => {
  if (!drag) return;
  const [dx, dy] = [event.clientX - drag.x, event.clientY - drag.y];
  drag.travel += Math.hypot(dx, dy);
  Object.assign(drag, { x: event.clientX, y: event.clientY });
  if (drag.pans) camera.pan(dx, dy, canvas.clientHeight);
  else camera.orbit(dx, dy);
  draw();
};
canvas.onpointerup = (event) => {
  if (drag && drag.travel < CLICK_PX && !drag.pans) pick(event.offsetX, event.offsetY);
  drag = null;
};
canvas.onpointercancel = () => { drag = null; };
canvas.oncontextmenu = (event) => event.preventDefault();
canvas.onwheel = (event) => {
  event.preventDefault();
  camera.zoom(Math.sign(event.deltaY) * 0.12);
  draw();
};

// Key to what it does, in words and as a function.
const KEYS = {
  " ": ["play or pause", () => player.toggle()],
  "ArrowLeft": ["one sweep back", () => send({ do: "step", by: -1 })],
  "ArrowRight": ["one sweep on", () => send({ do: "step", by: 1 })],
  "n": ["next object, the nearest first", selectNext],
  "Escape": ["no object", () => select(0, null)],
  "o": ["look from behind and above", () => look("lookFromBehind")],
  "t": ["look from above", () => look("lookFromAbove")],
  "f": ["follow the sensor", () => setFollowing(!follows)],
  "1": ["estimate", () => send({ do: "layer", name: "estimate" })],
  "2": ["truth, if it is known", () => send({ do: "layer", name: "truth" })],
  "3": ["error of the flow, if it is known", () => send({ do: "layer", name: "error" })],
  "p": ["panel", () => setFolded(!document.body.classList.contains("folded"))],
  "?": ["these keys", toggleKeys],
};
const NAMES = { " ": "space", "ArrowLeft": "\u2190", "ArrowRight": "\u2192", "Escape": "esc" };
const MOUSE = { "drag": "turn", "shift drag": "move", "wheel": "zoom", "click": "why?" };

function toggleKeys() {
  const dialog = find("#keys");
  if (dialog.open) dialog.close();
  else dialog.showModal();
}

// The time bar has the keys of the page; other fields and, for the space bar, buttons their own.
document.onkeydown = (event) => {
  const isOfField = event.target.closest(event.key === " "
    ? "input:not(#time), select, button, summary" : "input:not(#time), select");
  const isOfDialog = find("#keys").open && event.key !== "?";
  if (isOfField || isOfDialog || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key])
    return;
  event.preventDefault();
  KEYS[event.key][1]();
};

for (const [id, key] of Object.entries({ orbit: "o", top: "t", follow: "f", fold: "p", help: "?",
  forget: "Escape" })) find(`#${id}`).onclick = KEYS[key][1];
find("#keys").onclick = () => find("#keys").close();
showValues(find("#keys dl"), { ...Object.fromEntries(Object.entries(KEYS).map(([key, [text]]) =>
  [NAMES[key] ?? key, text])), ...MOUSE });
followSystem(() => { overlay.readTheme(); status.draw(); draw(); });
// Labels keep clear of the words above and below, whose sizes change.
const resized = new ResizeObserver(draw);
for (const one of [canvas, ...document.querySelectorAll("header, nav, #lost, #words")]) resized.observe(one);
// Without the token, which a picture of the page would give away.
find("#address").textContent = location.origin;
connect();
setFolded(innerWidth <= 800);
