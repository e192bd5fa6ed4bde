// Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
// The right side and the time bar: selection, status, parameters, player.

import { theme } from "./theme.js";

const find = (selector) => document.querySelector(selector);
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10];
const LATENCIES = 120;
const [PLAY, PAUSE] = ["M4 2v12l10-6z", "M3 2h4v12H3zM9 2h4v12H9z"];

export function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

export function showValues(list, values) {
  list.replaceChildren(...Object.entries(values).flatMap(([name, value]) =>
    [element("dt", { textContent: name }), element("dd", { textContent: value })]));
}

export class Player {
  constructor(send) {
    this.send = send;
    this.isHeld = false;
    const slider = find("#time");
    find("#play").onclick = () => this.toggle();
    find("#back").onclick = () => send({ do: "step", by: -1 });
    find("#next").onclick = () => send({ do: "step", by: 1 });
    slider.oninput = () => { this.isHeld = true; this.showClock(slider.valueAsNumber); };
    slider.onchange = () => { this.isHeld = false; send({ do: "seek", to: slider.valueAsNumber }); };
    const speed = find("#speed");
    speed.append(...SPEEDS.map((value) => element("option", { value, textContent: `${value}×` })));
    speed.onchange = () => send({ do: "speed", to: Number(speed.value) });
  }

  toggle() {
    this.send({ do: this.state?.playing ? "pause" : "play" });
  }

  show(state) {
    this.state = state;
    find("#player").hidden = false;
    find("#play path").setAttribute("d", state.playing ? PAUSE : PLAY);
    const speed = find("#speed");
    if (![...speed.options].some((option) => Number(option.value) === state.speed))
      speed.append(element("option", { value: state.speed, textContent: `${state.speed}×` }));
    speed.value = state.speed;
    const slider = find("#time");
    slider.max = state.duration;
    if (!this.isHeld) {
      slider.value = state.position ?? 0;
      this.showClock(state.position ?? 0, state.busy);
    }
  }

  showClock(position, busy = null) {
    const text = `${position.toFixed(1)} / ${this.state.duration.toFixed(1)} s`;
    find("#clock").textContent = busy === null ? text : `estimating ${busy.toFixed(1)} s`;
  }
}

export class Status {
  constructor() {
    this.latencies = [];
  }

  show({ latency, values, warnings }) {
    if (Number.isFinite(latency)) this.latencies = [...this.latencies, latency].slice(-LATENCIES);
    showValues(find("#status dl"), values);
    find("#status ul").replaceChildren(...warnings.map((warning) => element("li",
      { textContent: warning.text ?? warning, className: warning.level ?? "" })));
    this.draw();
  }

  draw() {
    const canvas = find("#latency"), context = canvas.getContext("2d");
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    Object.assign(canvas, { width: width * devicePixelRatio, height: height * devicePixelRatio });
    context.scale(devicePixelRatio, devicePixelRatio);
    // The first estimate may take much longer than the others.
    const sorted = [...this.latencies].sort((a, b) => a - b);
    const highest = Math.max(10, 1.5 * (sorted[Math.floor(0.9 * (sorted.length - 1))] ?? 0));
    context.strokeStyle = theme.accent;
    context.beginPath();
    const first = LATENCIES - this.latencies.length;
    this.latencies.forEach((value, k) =>
      context.lineTo((first + k) * width / (LATENCIES - 1), height * (1 - value / highest)));
    context.stroke();
    context.fillStyle = theme.faint;
    context.font = "11px system-ui, sans-serif";
    context.fillText(`${highest.toFixed(0)} ms`, 2, 11);
  }
}

export function showSelection(title, values, lines) {
  find("#selection").hidden = !title;
  if (!title) return;
  find("#selection h2 span").textContent = title;
  showValues(find("#selection dl"), values);
  find("#selection ul").replaceChildren(
    ...lines.map((line) => {
      const [term, ...text] = line.split(": ");
      return text.length ? element("li", {}, element("small", { textContent: `${term}:` }),
        ` ${text.join(": ")}`) : element("li", { textContent: line });
    }));
}

export class Knobs {
  constructor(send) {
    this.send = send;
    this.inputs = new Map();
    find("#filter").oninput = () => this.filter();
    find("#reset").onclick = () => send({ do: "reset" });
    find("#save").onclick = () => this.save();
  }

  show({ groups, file, changed, saved }) {
    this.file = file;
    const names = groups.flatMap((group) => group.knobs.map((knob) => knob.name)).join();
    if (names !== this.names) this.build(groups);
    this.names = names;
    for (const knob of groups.flatMap((group) => group.knobs)) {
      this.inputs.get(knob.name).set(knob.value);
      const isChanged = knob.value !== knob.default;
      this.inputs.get(knob.name).row.classList.toggle("changed", isChanged);
    }
    find("#reset").disabled = changed.length === 0;
    find("#save").disabled = saved.length === 0;
    find("#save").textContent = saved.length ? `save changes (${saved.length})` : "save changes";
    find("#save").title = saved.join(", ");
  }

  build(groups) {
    this.inputs.clear();
    find("#knobs > div").replaceChildren(...groups.map(({ name, text, knobs }) =>
      element("details", { open: name === "objects" },
        element("summary", {}, `${name} `, element("small", { textContent: text.replaceAll("`", "") })),
        ...knobs.map((knob) => this.row(knob)))));
    this.filter();
  }

  row(knob) {
    const change = (value) => this.send({ do: "set", name: knob.name, value });
    const { nodes, set } = INPUTS[knob.choices.length ? "choice" : knob.kind](knob, change);
    const [input, ...more] = nodes;
    input.id = knob.name;
    const short = knob.name.split(".")[1];
    const row = element("div", { className: "knob" },
      element("div", {}, element("label", { htmlFor: knob.name, textContent: short }), input),
      ...more, element("small", { textContent: knob.text + (knob.unit ? ` [${knob.unit}]` : "") }));
    this.inputs.set(knob.name, { set, row });
    return row;
  }

  filter() {
    const wanted = find("#filter").value.toLowerCase();
    for (const [, { row }] of this.inputs)
      row.hidden = !row.textContent.toLowerCase().includes(wanted);
    for (const group of document.querySelectorAll("#knobs details")) {
      group.hidden = !group.querySelector(".knob:not([hidden])");
      if (wanted) group.open = true;
    }
  }

  save() {
    const url = URL.createObjectURL(new Blob([this.file], { type: "application/yaml" }));
    element("a", { href: url, download: "changed.yaml" }).click();
    setTimeout(() => URL.revokeObjectURL(url), 1000);
  }
}

// Each gives its elements, the input itself first, and a function that sets it.
const INPUTS = {
  bool(_, change) {
    const input = element("input", { type: "checkbox" });
    input.onchange = () => change(input.checked);
    return { nodes: [input], set: (value) => { input.checked = value; } };
  },
  str(_, change) {
    const input = element("input", { type: "text" });
    input.onchange = () => change(input.value);
    return { nodes: [input], set: (value) => { input.value = value; } };
  },
  choice({ choices }, change) {
    const input = element("select", {},
      ...choices.map((value) => element("option", { value, textContent: value })));
    input.onchange = () => change(input.value);
    return { nodes: [input], set: (value) => { input.value = value; } };
  },
  float: (knob, change) => numberInput(knob, change, (value) => Number(value.toPrecision(3))),
  int: (knob, change) => numberInput(knob, change, Math.round),
};

// A number and a slider, whose middle is near the default.
function numberInput({ minimum, maximum, default: usual }, change, rounded) {
  const span = maximum - minimum, share = (usual - minimum) / span;
  const power = Math.min(8, Math.max(1, share > 0 ? Math.log(share) / Math.log(0.4) : 4));
  const input = element("input", { type: "number", min: minimum, max: maximum, step: "any" });
  const slider = element("input", { type: "range", min: 0, max: 1, step: 0.005 });
  slider.ariaLabel = "slider";
  const chosen = () => rounded(minimum + span * slider.valueAsNumber ** power);
  slider.oninput = () => { input.value = chosen(); };
  slider.onchange = () => change(chosen());
  input.onchange = () => input.value !== "" && change(input.valueAsNumber);
  const set = (value) => {
    input.value = value;
    slider.value = Math.max(0, (value - minimum) / span) ** (1 / power);
  };
  return { nodes: [input, slider], set };
}
