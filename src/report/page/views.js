// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Where to look next: poses of the sensor, as `accessvdb views` wrote them. Numbers count from 0, as in its files.

const VIEW_COLOURS = {first: [0, 110, 80], other: [150, 152, 156], chosen: ARROW_COLOURS.chosen};

// The list in the column. @param chosen  called with a view's number  @return a button for each
function fillViews(facts, chosen) {
  const {views, unresolved_points} = facts.views;
  const wayText = ({travel_m, way_is_free}) => {
    if (travel_m === 0) return way_is_free ? "at the same place" : "no start was given";
    return `${fixed(travel_m, 1)}\u202fm of way, ${way_is_free ? "known to be free" : "not known to be free"}`;
  };
  const buttons = views.map((view, n) => {
    const parts = [`${grouped(view.of_confidence)} seen too rarely`, `${grouped(view.of_unseen)} from the wrong side`,
                   `${grouped(view.of_unknown)} with unknown space before them`, wayText(view)];
    const button = element("button", "target", element("span", "rank", String(n)),
                           element("span", "why", `resolves about ${grouped(view.resolves)} points`),
                           element("span", "more", parts.join(" · ")));
    button.type = "button";
    button.addEventListener("click", () => chosen(n));
    return button;
  });
  byId("views-summary").textContent = `${grouped(views.length)} view${views.length === 1 ? "" : "s"}, in the order to go to them, ` +
      `for ${grouped(unresolved_points)} points of which too little is known. What each resolves is expected after those before it.`;
  byId("views").replaceChildren(...buttons.map((button) => element("li", "", button)));
  byId("next-views").hidden = false;
  return buttons;
}

// Edge of the pyramids: in proportion to the picture, and small beside the shortest way between two of them.
function viewSize_m(views, radius_m) {
  return Math.min(0.04 * radius_m, ...views.filter(({travel_m}) => travel_m > 0).map(({travel_m}) => 0.3 * travel_m));
}

// Pyramids as one mesh, each with its tip at the sensor, opening along the sensor's x axis.
// @param poses  seven numbers each, with the place from the points' anchor
function pyramidsMesh(painter, poses, size_m) {
  const vertices = [], triangles = [];
  for (const pose of poses) {
    const tip = pose.slice(0, 3), {x, y, z} = frameOfPose(pose), first = vertices.length / 3, half_m = 0.5 * size_m;
    vertices.push(...tip);
    for (const [side, up] of [[1, 1], [-1, 1], [-1, -1], [1, -1]]) {
      vertices.push(...add(add(tip, scaled(x, size_m)), add(scaled(y, side * half_m), scaled(z, up * half_m))));
    }
    const [a, b, c, d] = [1, 2, 3, 4];
    triangles.push(...[a, b, c, a, c, d, b, a, 0, c, b, 0, d, c, 0, a, d, 0].map((corner) => first + corner));
  }
  return painter.mesh(new Float32Array(vertices), new Uint32Array(triangles));
}
