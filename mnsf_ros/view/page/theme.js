// Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
// The colours of what is drawn, light or dark as the system is.

const LIGHT = matchMedia("(prefers-color-scheme: light)");
// On a light page, colours are darkened to this luminance; as in points.js.
const BRIGHTEST = 0.55;

export const theme = {};

// Calls `redraw` whenever the system changes from light to dark or back.
export function followSystem(redraw) {
  LIGHT.onchange = () => { read(); redraw(); };
}

// A colour, 0 to 255, as it is drawn on this page.
export function shownColor(rgb) {
  const luminance = (0.3 * rgb[0] + 0.59 * rgb[1] + 0.11 * rgb[2]) / 255;
  const share = theme.isLight ? Math.min(1, BRIGHTEST / Math.max(luminance, 1e-3)) : 1;
  return rgb.map((value) => share * value);
}

export function shownHex(hex) {
  return `rgb(${shownColor([1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16))).join(" ")})`;
}

function read() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ground", "ink", "faint", "ring", "label", "accent"])
    theme[name] = style.getPropertyValue(`--${name}`).trim();
  theme.isLight = LIGHT.matches;
}

read();
