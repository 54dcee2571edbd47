// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Where to go first: targets, and the approaches of each, as `accessvdb approaches` wrote them. Numbers count from 0, as
// in its files.

const POSES = [
  {key: "pre_contact", name: "Pre-contact"},
  {key: "contact", name: "Contact"},
  {key: "retreat", name: "Retreat"},
];
const CONTACT = 1;
// More numbers in the picture would hide it; the list has all targets.
const MOST_PINS = 200;
const PIN_HEIGHT_PX = 21;
const pinWidth_px = (number) => 14 + 8 * String(number).length;

// The axes of the tool. @param pose  seven numbers: the place, then a unit quaternion, w first
function frameOfPose(pose) {
  const [w, x, y, z] = pose.slice(3);
  return {
    x: [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    y: [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    z: [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  };
}

// Arrows as one mesh: thousands of them are drawn with one call.
// @param ways  pairs of places, from where and where to
function arrowsMesh(painter, ways) {
  const SIDES = 10, data = [];
  for (const [from, to] of ways) {
    const along = subtract(to, from), length_m = Math.hypot(...along);
    if (!(length_m > 0)) continue;
    const {x, y, z} = frameAlong(along, null), neck = 0.74 * length_m, shaft = 0.014 * length_m, head = 0.05 * length_m;
    const round = Array.from({length: SIDES + 1}, (_, side) => {
      const angle = 2 * Math.PI * side / SIDES;
      return add(scaled(y, Math.cos(angle)), scaled(z, Math.sin(angle)));
    });
    // Normals point outwards at the edges of the head, too: they say where thin arrows grow.
    const ring = (at_m, radius_m) => round.map((out) => [...add(from, add(scaled(x, at_m), scaled(out, radius_m))), ...out]);
    const rings = [[[0, 0], [0, shaft]], [[0, shaft], [neck, shaft]], [[neck, shaft], [neck, head]], [[neck, head], [length_m, 0]]];
    for (const [begin, end] of rings) {
      const a = ring(...begin), b = ring(...end);
      for (let side = 0; side < SIDES; ++side) data.push(a[side], b[side], a[side + 1], b[side], b[side + 1], a[side + 1]);
    }
  }
  return painter.corners(new Float32Array(data.flat()));
}

// The list in the column. @param chosen  called with a target's number  @return a button for each
function fillTargets(facts, chosen) {
  const {targets, accessible_points, covered_points} = facts.approaches;
  const names = new Set(targets.map(({tool_name}) => tool_name)), values = new Set(targets.map(({value}) => value));
  const buttons = targets.map((target, n) => {
    const ways = target.approaches.length;
    const more = [
      ways === 1 ? "one approach" : `${ways} approaches`,
      ...(names.size > 1 ? [target.tool_name] : []),
      ...(values.size > 1 ? [target.value === null ? "no value" : `value ${target.value}`] : []),
      ...(target.covers_points > 0 ? [`covers ${grouped(target.covers_points)} points`] : []),
    ];
    const button = element("button", "target", element("span", "rank", String(n)), element("span", "why", target.why),
                           element("span", "more", more.join(" · ")));
    button.type = "button";
    button.addEventListener("click", () => chosen(n));
    return button;
  });
  byId("approaches-summary").textContent = `${grouped(targets.length)} target${targets.length === 1 ? "" : "s"}, the best first` +
      `${values.size > 1 ? " for each value" : ""}. ${grouped(covered_points)} of ${grouped(accessible_points)} reachable points ` +
      "are near one.";
  byId("targets").replaceChildren(...buttons.map((button) => element("li", "", button)));
  byId("approaches").hidden = false;
  return buttons;
}

// Scrolls the list alone: on a narrow screen the picture must stay in view.
function showInList(button) {
  const list = button.closest("ol"), at = button.getBoundingClientRect(), frame = list.getBoundingClientRect();
  if (at.top < frame.top) list.scrollTop += at.top - frame.top;
  else if (at.bottom > frame.bottom) list.scrollTop += at.bottom - frame.bottom;
}

// Numbers in the picture: of targets, or of views. Where two would overlap, the better one stays.
class Pins {
  // @param marks  {title, place} of each  @param kind  "", or a class of the page's style
  constructor(marks, kind, chosen) {
    this.pins = marks.slice(0, MOST_PINS).map(({title, place}, n) => {
      const button = element("button", `pin ${kind}`.trim(), String(n));
      button.type = "button";
      button.title = title;
      button.addEventListener("click", () => chosen(n));
      return {button, place};
    });
    byId("pins").append(...this.pins.map(({button}) => button));
  }

  // @param current  a number, which comes before all others; -1 for none
  // @param taken    place and width of each pin that is there; those of here are added
  place(camera, current, taken) {
    const order = [...this.pins.keys()].sort((a, b) => Number(b === current) - Number(a === current));
    for (const n of order) {
      const {button, place} = this.pins[n], at = camera.toPixels(place);
      button.hidden = !at || taken.some(([x, y, width_px]) => Math.abs(x - at[0]) < (width_px + pinWidth_px(n)) / 2 &&
                                          Math.abs(y - at[1]) < PIN_HEIGHT_PX);
      button.setAttribute("aria-current", String(n === current));
      if (button.hidden) continue;
      taken.push([...at, pinWidth_px(n)]);
      button.style.left = `${at[0]}px`;
      button.style.top = `${at[1]}px`;
    }
  }
}

function segments(label, ...buttons) {
  const made = element("div", "segments", ...buttons);
  made.setAttribute("role", "group");
  made.setAttribute("aria-label", label);
  return made;
}

function stepButton(text, title, enabled, clicked) {
  const button = element("button", "", text);
  button.type = "button";
  button.title = title;
  button.disabled = !enabled;
  button.addEventListener("click", clicked);
  return button;
}

// @param number  of the target  @param way  number of its approach  @param pose  index in POSES
// @param tool    a Tool, or null  @param inside  drawn points inside it
// @param show    called with another approach and pose  @param close  called to leave
function fillApproachCard(card, {facts, number, way, pose, tool, inside, show, close}) {
  const target = facts.approaches.targets[number], approach = target.approaches[way];
  const digits = clamp(Math.ceil(-Math.log10(facts.frame.step_m)), 0, 5);
  const placeText = (place) => place.map((value) => fixed(value, digits)).join("  ") + "\u202fm";
  const last = target.approaches.length - 1;
  const steps = segments("Approach",
      stepButton("‹", "Previous approach", way > 0, () => show(way - 1, pose)),
      element("span", "step", `Approach ${way}`, element("span", "quiet", last === 0 ? "the only one" : ` 0 to ${last}`)),
      stepButton("›", "Next approach", way < last, () => show(way + 1, pose)));
  steps.classList.add("steps");
  const poses = segments("Pose", ...POSES.map(({key, name}, n) => {
    const button = stepButton(name, "", true, () => show(way, n));
    button.dataset.pose = key;
    button.setAttribute("aria-pressed", String(n === pose));
    return button;
  }));
  const values = element("table", "values",
      row("Point", (target.tile ? `${target.point} of tile ${target.tile}` : String(target.point))),
      row("Position", placeText(target.position)),
      row("Tool", target.tool_name),
      row("Tip is at", placeText(approach[POSES[pose].key].slice(0, 3))),
      row("Comes from", directionWords(frameOfPose(approach.contact).x, degreesText)),
      ...(target.margin_m === null ? [] : [row("Room", `${fixed(target.margin_m, 3)}\u202fm around it`)]),
      row("Can turn by", approach.free_arc_deg === null ? "not known" : `${fixed(approach.free_arc_deg, 0)}°`),
      row("Voxels touched", grouped(approach.collisions)),
      row("Seen free", `${fixed(approach.seen_free_m, 2)}\u202fm back from contact`),
      row("Confidence", target.confidence.toFixed(2)));
  const tool_line = target.tool === null
      ? [`The map has no tool of the name ${target.tool_name}, so it is not drawn.`]
      : [toolLine(tool, inside, {direction_W: true})].flat();
  const parts = [closeButton(close), element("h2", "", swatch(ARROW_COLOURS.chosen), `Target ${number}`),
                 element("p", "", `Ranked by: ${target.why}.`), steps, poses, values, element("p", "tool-line", ...tool_line)];
  if (tool && tool.facts.difference) parts.push(element("p", "warning", tool.facts.difference));
  card.replaceChildren(...parts);
  card.dataset.id = target.point;
  card.dataset.tile = target.tile;
  card.dataset.inside = inside;
  card.hidden = false;
}
