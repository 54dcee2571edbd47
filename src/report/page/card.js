// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The card of a point: what is known about it, and why.

// An element with a class and content: texts, which are never read as HTML, or other elements.
function element(name, style, ...content) {
  const made = document.createElement(name);
  if (style) made.className = style;
  made.append(...content);
  return made;
}

function swatch(colour) {
  const made = element("span", "swatch");
  made.style.backgroundColor = `rgb(${colour.join(" ")})`;
  return made;
}

function row(name, value) {
  return element("tr", "", element("th", "", name), element("td", "", value));
}

// The reason in a sentence, with the numbers of this point.
// @param prefix    of the keys of the metadata about the tool
// @param in_place  whether score and direction are shown
function sentence(point, metadata, prefix, in_place) {
  if (!in_place) return REASON_WORDS[point.reason].means;
  const limit = Number(metadata[`${prefix}collision_limit`]), allowed = limit > 0 ? `, where ${grouped(limit - 1)} may` : "";
  if (point.score !== null && point.reason === "tool") {
    return `Even in the best direction the tool would collide: ${grouped(point.score)} of its voxels touch something${allowed}.`;
  }
  if (point.score !== null && point.reason === "none") {
    const touched = point.score === 0 ? "none of its voxels touches anything" : `${grouped(point.score)} of its voxels touch something`;
    return `The tool fits: in the best direction ${touched}${allowed}. The way in was seen to be free.`;
  }
  return REASON_WORDS[point.reason].means + (point.direction_W ? " The arrow shows the direction that came closest." : "");
}

// @return a text, or a list of texts and elements
function toolLine(tool, inside, point) {
  if (!tool) return ["The tool is not in this report: make it with ", element("code", "", "--tool"), " to see it in place."];
  if (!point.direction_W) return "There is no direction in which to show the tool.";
  const drawn = inside === 1 ? "1 drawn point lies" : `${grouped(inside)} drawn points lie`;
  return `${tool.facts.name} in place. ${drawn} inside it` + (inside > 0 ? ", coloured yellow." : ".");
}

// Yaw, and pitch where the tool does not come level; +90 degrees is from above.
function directionWords(d, degrees) {
  const pitch = Math.asin(clamp(d[2], -1, 1)) * 180 / Math.PI;
  const tilt = Math.abs(pitch) < 0.05 ? "" : `, pitch ${pitch > 0 ? "+" : "−"}${Math.abs(pitch).toFixed(1)}°`;
  return Math.abs(pitch) > 89.95 ? (pitch > 0 ? "from above" : "from below")
                                 : `yaw ${degrees(Math.atan2(d[1], d[0]))}${tilt}`;
}

const degreesText = (radians) => ((radians * 180 / Math.PI + 360) % 360).toFixed(1) + "°";

function closeButton(close) {
  const button = element("button", "close", "×");
  button.type = "button";
  button.title = "Close (Esc)";
  button.addEventListener("click", close);
  return button;
}

// @param facts   the report's
// @param chosen  index of one of several tools, or ANY_TOOL
// @param tool    a Tool, or null
// @param inside  drawn points inside it
// @param targets  numbers of the targets there  @param go  called with one of them
function fillCard(card, {point, facts, chosen, tool, inside, targets, go, close}) {
  const words = REASON_WORDS[point.reason];
  const digits = clamp(Math.ceil(-Math.log10(facts.frame.step_m)), 0, 5);
  const d = point.direction_W;
  const values = element("table", "values",
      row("Point", (point.tile ? `${point.id} of tile ${point.tile}` : String(point.id))),
      row("Position", point.position_W.map((value) => fixed(value, digits)).join("  ") + "\u202fm"),
      row("Label", LABEL_WORDS[point.label]),
      ...(point.tools ? [row("Reached by", point.tools.map((k) => facts.tools[k].name).join(", ") || "no tool"),
                         row(point.tools.length > 0 ? "Way in of" : "Closest", facts.tools[point.tool].name)] : []),
      ...(point.margin_m === null ? [] : [row("Room", `${fixed(point.margin_m, 3)}\u202fm around it`)]),
      row("Best direction", d ? directionWords(d, degreesText) : "none"),
      row("Voxels touched", point.score === null ? "not tested" : grouped(point.score)),
      row("Confidence", point.confidence.toFixed(2)),
      ...(point.probability === null ? [] : [row("Probability", `${(100 * point.probability).toFixed(1)}\u202f% that the tool gets there`)]));
  const title = element("h2", "", swatch(REASON_COLOURS[point.reason]), words.name);
  const in_place = !point.tools || standsFor(point, chosen);
  const tool_line = element("p", "tool-line", ...[in_place ? toolLine(tool, inside, point) : toolsLine(point, facts, chosen)].flat());
  const prefix = point.tools ? `tool_${facts.tools[point.tool].name}_` : "";
  const parts = [closeButton(close), title, element("p", "", sentence(point, facts.metadata, prefix, in_place)),
                 element("p", "todo", words.todo), values, tool_line];
  if (in_place && tool && tool.facts.difference) parts.push(element("p", "warning", tool.facts.difference));
  for (const number of targets) {
    const button = element("button", "go", `Approaches of target ${number}`);
    button.type = "button";
    button.addEventListener("click", () => go(number));
    parts.push(button);
  }
  card.replaceChildren(...parts);
  card.dataset.id = point.id;
  card.dataset.tile = point.tile;
  card.dataset.inside = inside;
  card.hidden = false;
}
