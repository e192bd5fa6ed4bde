// Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
// The points of a sweep, drawn by WebGL.

import { theme } from "./theme.js";

const VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in uint packed_color;
uniform mat4 clip_from_sensor;
uniform float pixels_per_metre;  // of something 1 m away
uniform float distance;
uniform bool is_light;  // of the page
out vec3 color;
flat out float is_large;
void main() {
  gl_Position = clip_from_sensor * vec4(position, 1.0);
  float depth = max(gl_Position.w, 0.3);
  is_large = float(packed_color >> 24u);
  float size_px = pixels_per_metre / depth * (is_large > 0.5 ? 0.11 : 0.06);
  gl_PointSize = clamp(size_px, is_large > 0.5 ? 2.4 : 1.4, is_large > 0.5 ? 10.0 : 6.0);
  color = vec3(packed_color >> 16u & 255u, packed_color >> 8u & 255u, packed_color & 255u) / 255.0;
  float height = smoothstep(-2.0, 2.0, position.z);
  if (is_large > 0.5)  // enough shade to see the shape
    color *= mix(0.7, 1.15, height);
  else  // the ground and what is far away stay in the background
    color *= mix(vec3(0.5, 0.55, 0.66), vec3(1.3, 1.34, 1.42), height)
      * clamp(1.35 - 0.35 * depth / distance, 0.4, 1.1);
  float luminance = dot(color, vec3(0.3, 0.59, 0.11));
  if (is_light && is_large > 0.5)
    color *= min(1.0, 0.55 / max(luminance, 0.001));
  else if (is_light)  // what is dark on dark is light on light
    color += 1.0 - 2.0 * luminance;
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec3 color;
flat in float is_large;
out vec4 pixel;
void main() {
  if (is_large > 0.5 && length(gl_PointCoord - 0.5) > 0.5) discard;
  pixel = vec4(color, 1.0);
}`;

export class Points {
  constructor(canvas) {
    this.gl = canvas.getContext("webgl2", { antialias: false });
    if (!this.gl) throw new Error("this browser has no WebGL 2");
    const gl = this.gl;
    this.program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS))
      throw new Error(gl.getProgramInfoLog(this.program) || "WebGL cannot link its program");
    [this.positions, this.colors] = [gl.createBuffer(), gl.createBuffer()];
    this.count = 0;
    gl.enable(gl.DEPTH_TEST);
  }

  show(xyz, colors) {
    const gl = this.gl;
    this.count = colors.length;
    for (const [buffer, data] of [[this.positions, xyz], [this.colors, colors]]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    }
  }

  draw(clipFromSensor, distance) {
    const gl = this.gl, { width, height } = gl.canvas;
    gl.viewport(0, 0, width, height);
    const ground = [1, 3, 5].map((at) => parseInt(theme.ground.slice(at, at + 2), 16) / 255);
    gl.clearColor(...ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    const place = (name) => gl.getUniformLocation(this.program, name);
    gl.uniformMatrix4fv(place("clip_from_sensor"), true, clipFromSensor);
    gl.uniform1f(place("pixels_per_metre"), height);
    gl.uniform1f(place("distance"), distance);
    gl.uniform1i(place("is_light"), theme.isLight);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.positions);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.colors);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribIPointer(1, 1, gl.UNSIGNED_INT, 0, 0);
    gl.drawArrays(gl.POINTS, 0, this.count);
  }
}
