// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Draws with WebGL2, in three steps:
//   points   as discs that lie in their surface, into a picture with depths
//   shading  that picture onto the canvas; what lies behind a neighbour is darkened ("eye-dome lighting", Boucheny 2009),
//            which shows shapes without a normal per pixel
//   solids   tool and arrow over it, against the same depths

const BACKGROUND = [0.976, 0.976, 0.970];

class Painter {
  constructor(canvas, points) {
    const gl = canvas.getContext("webgl2", {antialias: true, alpha: false, powerPreference: "high-performance"});
    if (!gl) throw new Error("this browser has no WebGL2, which draws the points");
    this.gl = gl;
    this.canvas = canvas;
    this.points = points;
    this.uploaded = 0;
    this.heights = [0, 1];
    this.solids = [];     // {mesh, placed, colour, grow_px, rim_px}; the last two may be left out
    this.standing = [];   // such solids that stay whatever is chosen
    this.focus = [0, 0, 0, 0];  // a place and a radius: what is farther away fades; 0 = nothing fades
    this.within = null;   // a box {low, high}: what is outside fades
    this.marked = 0;      // points with a mark
    this.point_program = this.program(POINT_VERTEX, POINT_FRAGMENT);
    this.shading_program = this.program(SCREEN_VERTEX, SHADING_FRAGMENT);
    this.solid_program = this.program(SOLID_VERTEX, SOLID_FRAGMENT);
    this.screen = gl.createVertexArray();
    this.makePointBuffers();
    this.picture = {width: 0, height: 0, frame: gl.createFramebuffer(), colours: gl.createTexture(),
                    depths: gl.createTexture()};
    this.largest_px = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const places = {};
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
    for (let n = 0; n < count; ++n) {
      const {name} = gl.getActiveUniform(program, n);
      places[name.replace("[0]", "")] = gl.getUniformLocation(program, name);
    }
    return {program, places};
  }

  makePointBuffers() {
    const gl = this.gl;
    this.point_array = gl.createVertexArray();
    gl.bindVertexArray(this.point_array);
    this.position_buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.position_buffer);
    gl.bufferData(gl.ARRAY_BUFFER, Math.max(this.points.positions.byteLength, 12), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    this.look_buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.look_buffer);
    gl.bufferData(gl.ARRAY_BUFFER, Math.max(this.points.looks.byteLength, 4), gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribIPointer(1, 4, gl.UNSIGNED_BYTE, 0, 0);
    this.probability_buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.probability_buffer);
    gl.bufferData(gl.ARRAY_BUFFER, Math.max(this.points.probabilities.byteLength, 1), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(2);
    gl.vertexAttribIPointer(2, 1, gl.UNSIGNED_BYTE, 0, 0);
    gl.bindVertexArray(null);
  }

  // Draws nothing with everything, so that the driver translates the shaders while points are still being unpacked.
  warmUp(camera) {
    this.uploaded = Math.min(1, this.points.ids.length);
    this.draw(camera, {mode: 0, hidden: -1 >>> 0}, 1);
    this.uploaded = 0;
  }

  // Takes over what was unpacked since the last call.
  upload() {
    const gl = this.gl, {positions, looks, probabilities, count} = this.points;
    if (count === this.uploaded) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.position_buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 12 * this.uploaded, positions, 3 * this.uploaded, 3 * (count - this.uploaded));
    gl.bindBuffer(gl.ARRAY_BUFFER, this.look_buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 4 * this.uploaded, looks, 4 * this.uploaded, 4 * (count - this.uploaded));
    gl.bindBuffer(gl.ARRAY_BUFFER, this.probability_buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, this.uploaded, probabilities, this.uploaded, count - this.uploaded);
    this.uploaded = count;
  }

  // After the marks of some points changed.
  uploadMarks() {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.look_buffer);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 0, this.points.looks, 0, 4 * this.uploaded);
  }

  // A mesh for `solids`, with one normal per triangle.
  mesh(vertices, triangles) {
    const gl = this.gl, data = new Float32Array(6 * triangles.length);
    for (let t = 0; t < triangles.length; t += 3) {
      const corners = [0, 1, 2].map((k) => [...vertices.subarray(3 * triangles[t + k], 3 * triangles[t + k] + 3)]);
      const normal = cross(subtract(corners[1], corners[0]), subtract(corners[2], corners[0]));
      const length = Math.hypot(...normal) || 1;
      corners.forEach((corner, k) => data.set([...corner, ...scaled(normal, 1 / length)], 6 * (t + k)));
    }
    return this.corners(data);
  }

  // The same from the corners of triangles: place and normal of each.
  corners(data) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    for (const place of [0, 1]) {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 24, 12 * place);
    }
    gl.bindVertexArray(null);
    return {array, count: data.length / 6};
  }

  resizePicture(width, height) {
    const gl = this.gl, picture = this.picture;
    if (picture.width === width && picture.height === height) return;
    Object.assign(picture, {width, height});
    gl.bindFramebuffer(gl.FRAMEBUFFER, picture.frame);
    for (const [texture, format, part, type, place] of [
      [picture.colours, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, gl.COLOR_ATTACHMENT0],
      [picture.depths, gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, gl.DEPTH_ATTACHMENT],
    ]) {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, format, width, height, 0, part, type, null);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, place, gl.TEXTURE_2D, texture, 0);
    }
  }

  // Radius of a point's disc: neighbours overlap whatever their direction.
  disc_m() {
    const {frame, points} = this.points.facts;
    return 0.8 * Math.max(frame.voxel_size_m, points.cell_m);
  }
  // Limits of the disc's diameter, in pixels of the page.
  static LEAST_PX = 1.6;
  static MOST_PX = 60;

  // @param look   {mode, hidden}: index in COLOUR_MODES, one bit per reason
  // @param finer  1 while moving, 2 when there is time for smooth edges
  draw(camera, look, finer) {
    const gl = this.gl, ratio = this.canvas.width / camera.width;
    finer = Math.max(this.canvas.width, this.canvas.height) * finer <= this.largest_px ? finer : 1;
    this.resizePicture(this.canvas.width * finer, this.canvas.height * finer);
    const to_clip = new Float32Array(camera.toClip()), eye = camera.eye();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.picture.frame);
    gl.viewport(0, 0, this.picture.width, this.picture.height);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
    gl.clearColor(...BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.drawPoints(camera, look, {to_clip, eye, scale: ratio * finer});
    this.shade(camera, finer, ratio);
    this.drawSolids(to_clip, eye, camera.focal_px());
    if (this.marked > 0) this.drawMarked(camera, look, {to_clip, eye, scale: ratio});
  }

  // Marked points also show through what hides them.
  drawMarked(camera, look, view) {
    const gl = this.gl;
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    gl.depthFunc(gl.GREATER);
    this.drawPoints(camera, look, {...view, only_marked: true});
    gl.disable(gl.BLEND);
    gl.depthMask(true);
  }

  drawPoints(camera, look, {to_clip, eye, scale, only_marked = false}) {
    const gl = this.gl, {program, places} = this.point_program;
    if (this.uploaded === 0) return;
    const {right, up, back} = camera.axes(), {near, far} = camera.depths();
    gl.useProgram(program);
    gl.uniformMatrix4fv(places.to_clip, false, to_clip);
    gl.uniform3fv(places.eye, eye);
    gl.uniformMatrix3fv(places.to_viewer, false, [0, 1, 2].flatMap((axis) => [right[axis], up[axis], back[axis]]));
    gl.uniform2f(places.depth_range, near, far);
    gl.uniform4fv(places.focus, this.focus);
    gl.uniform1i(places.boxed, this.within ? 1 : 0);
    if (this.within) {
      gl.uniform3fv(places.box_low, this.within.low);
      gl.uniform3fv(places.box_high, this.within.high);
    }
    gl.uniform3fv(places.background, BACKGROUND);
    gl.uniform1i(places.only_marked, only_marked ? 1 : 0);
    gl.uniform1f(places.alpha, only_marked ? 0.6 : 1);
    gl.uniform1f(places.disc_radius_m, this.disc_m());
    gl.uniform1f(places.target_m, camera.distance);
    gl.uniform1f(places.scale, scale);
    gl.uniform1f(places.disc_px_m, 2 * this.disc_m() * camera.focal_px() * scale);
    gl.uniform1f(places.least_px, Painter.LEAST_PX * scale);
    gl.uniform1f(places.most_px, Painter.MOST_PX * scale);
    gl.uniform1i(places.mode, look.mode);
    gl.uniform1ui(places.hidden, look.hidden);
    const colours = (list) => new Float32Array(list.flat().map((value) => value / 255));
    gl.uniform3fv(places.reasons, colours(REASONS.map((reason) => REASON_COLOURS[reason])));
    gl.uniform3fv(places.labels, colours(LABELS.map((label) => LABEL_COLOURS[label])));
    gl.uniform3fv(places.in_tool, colours([IN_TOOL_COLOUR]));
    gl.uniform2fv(places.heights, this.heights);
    gl.bindVertexArray(this.point_array);
    gl.drawArrays(gl.POINTS, 0, this.uploaded);
  }

  shade(camera, finer, ratio) {
    const gl = this.gl, {program, places} = this.shading_program;
    const {near, far} = camera.depths();
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.depthFunc(gl.ALWAYS);
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.picture.colours);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.picture.depths);
    gl.uniform1i(places.colours, 0);
    gl.uniform1i(places.depths, 1);
    gl.uniform1i(places.finer, finer);
    gl.uniform2f(places.depth_range, near, far);
    gl.uniform1f(places.reach_px, 1.2 * ratio);
    gl.uniform1f(places.disc_m, this.disc_m());
    gl.uniform3fv(places.background, BACKGROUND);
    gl.bindVertexArray(this.screen);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    // The textures may not stay bound while the next frame draws into them.
    for (const unit of [gl.TEXTURE0, gl.TEXTURE1]) {
      gl.activeTexture(unit);
      gl.bindTexture(gl.TEXTURE_2D, null);
    }
  }

  // Each solid twice: faintly through what hides it, then its nearest faces; before them its rim in white.
  drawSolids(to_clip, eye, focal_px) {
    const solids = [...this.standing, ...this.solids];
    if (solids.length === 0) return;
    const gl = this.gl, {program, places} = this.solid_program;
    gl.useProgram(program);
    gl.uniformMatrix4fv(places.to_clip, false, to_clip);
    gl.uniform3fv(places.eye, eye);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const pass = (solid, alpha, {colour = solid.colour, rim_px = 0} = {}) => {
      gl.uniformMatrix4fv(places.placed, false, new Float32Array(solid.placed));
      gl.uniform4f(places.colour, ...colour.slice(0, 3), alpha);
      gl.uniform1f(places.grow, ((solid.grow_px || 0) + rim_px) / focal_px);
      gl.bindVertexArray(solid.mesh.array);
      gl.drawArrays(gl.TRIANGLES, 0, solid.mesh.count);
    };
    for (const solid of solids) {
      gl.enable(gl.BLEND);
      gl.depthMask(false);
      gl.depthFunc(gl.GREATER);
      pass(solid, 0.35 * solid.colour[3]);
    }
    gl.depthFunc(gl.LESS);
    for (const solid of solids) {
      if (solid.rim_px) pass(solid, 0.8 * solid.colour[3], {colour: [1.6, 1.6, 1.6], rim_px: solid.rim_px});
    }
    for (const solid of solids) {
      gl.depthMask(true);
      gl.depthFunc(gl.LESS);
      gl.colorMask(false, false, false, false);
      pass(solid, 1);
      gl.colorMask(true, true, true, true);
      gl.depthFunc(gl.EQUAL);
      pass(solid, solid.colour[3]);
    }
    gl.disable(gl.BLEND);
    gl.depthMask(true);
  }

  // Waits until everything is drawn: for measuring.
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}

// An arrow of unit length along +x, to be scaled: a shaft with a head, all round.
function arrowMesh(painter, length_m) {
  const vertices = [], triangles = [], sides = 20;
  const shaft = 0.006 * length_m, head = 0.022 * length_m, neck = 0.92 * length_m;
  const rings = [[0, 0], [0, shaft], [neck, shaft], [neck, head], [length_m, 0]];
  for (const [x, radius] of rings) {
    for (let side = 0; side < sides; ++side) {
      const angle = 2 * Math.PI * side / sides;
      vertices.push(x, radius * Math.cos(angle), radius * Math.sin(angle));
    }
  }
  for (let ring = 0; ring + 1 < rings.length; ++ring) {
    for (let side = 0; side < sides; ++side) {
      const a = ring * sides + side, b = ring * sides + (side + 1) % sides;
      triangles.push(a, b, a + sides, b, b + sides, a + sides);
    }
  }
  return painter.mesh(new Float32Array(vertices), new Uint32Array(triangles));
}
