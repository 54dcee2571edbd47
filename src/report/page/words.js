// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
"use strict";
// What the report says about each reason, and the colours that stand for it.

const LABELS = ["unscored", "accessible", "blocked"];
// The last one is none of points.ply: with one of several tools chosen, what only others reach.
const REASONS = ["none", "confidence", "normal", "unseen", "unknown", "arm", "tool", "changed", "beside_surface", "other"];

// The palette of Okabe and Ito (2008), "Color Universal Design", which colour-blind people can tell apart; grey where
// too little was seen. The same as in preview.png with --colour reason.
const REASON_COLOURS = {
  none: [0, 158, 115],
  confidence: [150, 152, 156],
  normal: [204, 121, 167],
  unseen: [86, 180, 233],
  unknown: [0, 114, 178],
  arm: [230, 159, 0],
  tool: [213, 94, 0],
  changed: [240, 228, 66],
  beside_surface: [205, 207, 211],
  other: [46, 48, 54],
};
const LABEL_COLOURS = {unscored: [150, 152, 156], accessible: [0, 158, 115], blocked: [213, 94, 0]};
const IN_TOOL_COLOUR = [250, 228, 40];
// Apart by how dark they are; a white rim parts them from the points.
const ARROW_COLOURS = {first: [24, 26, 32], other: [172, 176, 184], chosen: [213, 94, 0]};

const LABEL_WORDS = {unscored: "not judged", accessible: "reachable", blocked: "not reachable"};

// Order of the list: good news first, then what can be changed most easily.
const REASON_ORDER = ["none", "other", "tool", "arm", "unknown", "unseen", "normal", "confidence", "changed", "beside_surface"];
const REASON_WORDS = {
  none: {
    name: "Reachable",
    short: "",  // in tables
    means: "The tool fits here in at least one direction, and the way in was seen to be free.",
    todo: "A candidate. Check the way of the whole machine.",
  },
  tool: {
    name: "Tool collides",
    short: "tool",
    means: "The tool would touch something, even in the best direction.",
    todo: "Use another tool, or another point.",
  },
  arm: {
    name: "Way in is blocked",
    short: "way in",
    means: "Something stands in the straight way in.",
    todo: "Use another point. If the obstacle was cut or has moved, make a new map.",
  },
  unknown: {
    name: "Way in was never seen",
    short: "not seen",
    means: "The straight way in runs through space that no scan has looked at.",
    todo: "Go there and scan.",
  },
  unseen: {
    name: "Seen from other sides only",
    short: "other side",
    means: "The point was never seen from a side that the tool could come from.",
    todo: "Scan from that side.",
  },
  normal: {
    name: "No direction fits the surface",
    short: "direction",
    means: "No approach direction comes near enough to the surface's normal, as on level ground.",
    todo: "Not for this tool and these directions.",
  },
  confidence: {
    name: "Seen too rarely",
    short: "too few",
    means: "Too few measurements to judge.",
    todo: "Scan longer, or from nearer.",
  },
  changed: {
    name: "Has gone",
    short: "gone",
    means: "What was measured here is no longer there: rays went through it.",
    todo: "Nothing: there is no surface here any more.",
  },
  beside_surface: {
    name: "Beside the surface",
    short: "beside",
    means: "Noise put this point beside the surface. Another one, nearer to it, is judged in its place.",
    todo: "Look at the judged point.",
  },
  other: {
    name: "By another tool only",
    short: "other tool",
    means: "The chosen tool does not reach it, another one of the run does.",
    todo: "Take one that its card names.",
  },
};

const COLOUR_MODES = [
  {key: "reason", name: "Reason"},
  {key: "label", name: "Reachable"},
  {key: "confidence", name: "Confidence"},
  {key: "height", name: "Height"},
  {key: "margin", name: "Room"},  // only of a field with margins
  {key: "probability", name: "Probability"},  // only where points have one
];

// 1234567 as "1 234 567", with narrow spaces that do not break.
function grouped(number) {
  return String(Math.round(number)).replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

function percent(part, whole) {
  if (!(part > 0)) return "0\u202f%";
  const share = 100 * part / whole;
  return (share < 0.1 ? "< 0.1" : share.toFixed(1)) + "\u202f%";
}

function areaText(area_m2) {
  if (area_m2 === 0) return "0\u202fm²";
  const digits = area_m2 >= 100 ? 0 : area_m2 >= 10 ? 1 : area_m2 >= 0.1 ? 2 : 4;
  return (digits === 0 ? grouped(area_m2) : area_m2.toFixed(digits)) + "\u202fm²";
}

// Like toFixed(), but never "-0.0".
function fixed(value, digits) {
  return value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");
}

function lengthText(length_m) {
  if (length_m >= 1) return +length_m.toPrecision(4) + "\u202fm";
  if (length_m >= 0.01) return +(length_m * 100).toPrecision(4) + "\u202fcm";
  return +(length_m * 1000).toPrecision(4) + "\u202fmm";
}
