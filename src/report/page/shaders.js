// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The programs of painter.js, in GLSL.

const POINT_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 position;
layout(location = 1) in uvec4 look;  // label + 4 reason, confidence, normal, inside the tool + 2 room
layout(location = 2) in uint probability;  // half percents; 255: none
uniform mat4 to_clip;
uniform mat3 to_viewer;      // directions
uniform vec3 eye;
uniform float target_m;      // distance of what the camera turns around
uniform float scale;         // pixels per pixel of the page
uniform float disc_radius_m;
uniform float disc_px_m, least_px, most_px;  // the disc's diameter in pixels at distance 1, and its limits
uniform int mode;            // of COLOUR_MODES
uniform uint hidden;         // one bit per reason
uniform bool only_marked;
uniform vec3 reasons[10], labels[3], in_tool, background;
uniform vec2 heights;        // that the colours span
uniform vec4 focus;          // a place and a radius: what is farther away fades; 0 = nothing fades
uniform bool boxed;
uniform vec3 box_low, box_high;  // what is outside fades
out vec3 colour;
flat out vec3 normal_V;      // of the disc, towards the viewer
flat out float away_m, disc_m;

vec3 normalOf(uint code) {
  vec2 uv = vec2(float(code % 15u), float(code / 15u)) / 7.0 - 1.0;
  vec3 n = vec3(uv, 1.0 - abs(uv.x) - abs(uv.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  return normalize(n);
}

// Viridis of matplotlib (CC0), as a polynomial.
vec3 ramp(float t) {
  const vec3 c0 = vec3(0.2777273, 0.0054073, 0.3340998), c1 = vec3(0.1050930, 1.4046135, 1.3845901),
             c2 = vec3(-0.3308618, 0.2148476, 0.0950952), c3 = vec3(-4.6342305, -5.7991010, -19.3324409),
             c4 = vec3(6.2282699, 14.1799334, 56.6905526), c5 = vec3(4.7763850, -13.7451454, -65.3530326),
             c6 = vec3(-5.4354559, 4.6458526, 26.3124352);
  return clamp(c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6))))), 0.0, 1.0);
}

void main() {
  uint reason = look.x >> 2u, label = look.x & 3u;
  bool marked = (look.w & 1u) == 1u;
  uint room = look.w >> 1u;  // 0: no tool reaches it; else 1 to 127
  if ((hidden >> reason & 1u) == 1u && !marked || only_marked && !marked) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside
    gl_PointSize = 0.0;
    return;
  }
  if (marked) colour = in_tool;
  else if (mode == 0) colour = reasons[min(reason, 9u)];
  else if (mode == 1) colour = labels[min(label, 2u)];
  else if (mode == 2) colour = ramp(float(look.y) / 255.0);
  else if (mode == 4) colour = room == 0u ? labels[0] : ramp(float(room - 1u) / 126.0);
  else if (mode == 5) colour = probability == 255u ? labels[0] : ramp(float(probability) / 200.0);
  else colour = ramp(clamp((position.z - heights.x) / max(heights.y - heights.x, 1e-6), 0.0, 1.0));
  vec3 facing = vec3(0.0, 0.0, 1.0);
  if (look.z != 255u) {
    vec3 n = normalOf(look.z), v = normalize(eye - position);
    if (dot(n, v) < 0.0) n = -n;
    float light = 0.68 + 0.24 * dot(n, v) + 0.20 * dot(n, normalize(vec3(0.35, -0.25, 0.9)));
    colour *= light;
    facing = to_viewer * n;
  }
  gl_Position = to_clip * vec4(position, 1.0);
  away_m = gl_Position.w;
  float wanted_px = disc_px_m / away_m;
  float nearness = min(1.0, 2.0 * away_m / target_m);  // small where they would stand before what is looked at
  gl_PointSize = clamp(wanted_px * nearness * nearness, least_px, most_px);
  if (focus.w > 0.0 && !marked && distance(position, focus.xyz) > focus.w) {
    colour = mix(colour, background, 0.6);
    if (away_m < (to_clip * vec4(focus.xyz, 1.0)).w) gl_PointSize = min(gl_PointSize, 2.0 * scale);  // a haze
  }
  if (boxed && (any(lessThan(position, box_low)) || any(greaterThan(position, box_high)))) colour = mix(colour, background, 0.75);
  disc_m = disc_radius_m * gl_PointSize / wanted_px;
  // Never quite on edge; and the smaller it looks, the rounder, so that distant surfaces stay closed.
  float tilt = smoothstep(3.0, 12.0, gl_PointSize / scale);
  normal_V = normalize(vec3(tilt * facing.xy, mix(1.0, max(facing.z, 0.35), tilt)));
}`;

const POINT_FRAGMENT = `#version 300 es
precision highp float;
in vec3 colour;
flat in vec3 normal_V;
flat in float away_m, disc_m;
uniform vec2 depth_range;  // near, far
uniform float alpha;
out vec4 result;
void main() {
  vec2 at = vec2(2.0, -2.0) * gl_PointCoord + vec2(-1.0, 1.0);
  float towards = -dot(at, normal_V.xy) / normal_V.z;  // height of the disc there, in its radii
  if (dot(at, at) + towards * towards > 1.0) discard;
  float away = max(away_m - towards * disc_m, depth_range.x);
  gl_FragDepth = (depth_range.y - depth_range.x * depth_range.y / away) / (depth_range.y - depth_range.x);
  result = vec4(colour * alpha, alpha);
}`;

const SCREEN_VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

// `finer`: edge of the picture's pixels that make one of the canvas.
const SHADING_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D colours;
uniform highp sampler2D depths;
uniform int finer;
uniform vec2 depth_range;  // near, far
uniform float reach_px, disc_m;
uniform vec3 background;
out vec4 result;

float metresAway(ivec2 at) {
  float d = texelFetch(depths, at, 0).r;
  return depth_range.x * depth_range.y / (depth_range.y - d * (depth_range.y - depth_range.x));
}

void main() {
  ivec2 size = textureSize(depths, 0), first = ivec2(gl_FragCoord.xy) * finer;
  vec3 sum = vec3(0.0);
  float nearest = 1.0;
  int step_px = max(int(reach_px * float(finer) + 0.5), 1);
  for (int y = 0; y < finer; ++y) {
    for (int x = 0; x < finer; ++x) {
      ivec2 at = min(first + ivec2(x, y), size - 1);
      float depth = texelFetch(depths, at, 0).r;
      nearest = min(nearest, depth);
      if (depth >= 1.0) {
        sum += background;
        continue;
      }
      // The discs of one surface overlap: steps that are smaller than a disc are no edge.
      float here = log2(max(metresAway(at) - disc_m, depth_range.x)), behind = 0.0;
      for (int n = 0; n < 8; ++n) {
        float angle = 0.7853981634 * float(n);
        ivec2 beside = clamp(at + ivec2(round(float(step_px) * vec2(cos(angle), sin(angle)))), ivec2(0), size - 1);
        behind += max(0.0, here - log2(metresAway(beside)));
      }
      sum += texelFetch(colours, at, 0).rgb * exp(-min(behind * 20.0, 0.9));
    }
  }
  result = vec4(sum / float(finer * finer), 1.0);
  gl_FragDepth = nearest;
}`;

const SOLID_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
uniform mat4 to_clip, placed;
uniform float grow;  // along the normals, per metre of distance: thin things stay visible from afar
out vec3 normal_W, at_W;
void main() {
  vec4 p = placed * vec4(position, 1.0);
  normal_W = mat3(placed) * normal;
  p.xyz += grow * (to_clip * p).w * normal_W;
  at_W = p.xyz;
  gl_Position = to_clip * p;
}`;

const SOLID_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 normal_W, at_W;
uniform vec3 eye;
uniform vec4 colour;
out vec4 result;
void main() {
  float facing = abs(dot(normalize(normal_W), normalize(eye - at_W)));
  result = vec4(colour.rgb * (0.45 + 0.55 * facing) * colour.a, colour.a);
}`;
