// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Several tools: the choice among them, and the same facts as one of them has them.

const ANY_TOOL = -1;

// 0 of a field without margins.
// Whether points have one: not those of the paper's profile, nor of files of before.
function hasProbability(facts) { return Boolean(facts.metadata.access_probability); }
function widestMargin(facts) { return Math.max(0, ...(facts.tools || []).map(({margin_m}) => margin_m)); }

// Points and areas by label and reason, and rows of tables, for one tool. Where no tool reaches, the result has the reason
// of the one that came closest.
// @param chosen  index, or ANY_TOOL
function factsFor(facts, chosen) {
  if (chosen === ANY_TOOL) return facts;
  const classes = facts.classes.flatMap((each) => {
    if (!each.tools) return [each];
    const own = each.tools[chosen];
    return [{...each, ...own}, {label: "blocked", reason: "other", points: each.points - own.points, area_m2: each.area_m2 - own.area_m2}];
  });
  const rowFor = (row) => {
    const own_m2 = row.tools[chosen].area_m2, other_m2 = (row.reasons_m2.none || 0) - own_m2;
    return {...row, reasons_m2: {...row.reasons_m2, none: own_m2, ...(other_m2 > 0 ? {other: other_m2} : {})}};
  };
  const tables = facts.tables && facts.tables.map((table) => ({...table, rows: table.rows.map(rowFor)}));
  return {...facts, classes: classes.filter((each) => each.points > 0), ...(tables ? {tables} : {})};
}

// The list of tools, each with the share that it reaches.
function fillTools(facts, chosen) {
  if (!facts.tools) return;
  const share = (k) => {
    const reached = factsFor(facts, k).classes.filter((each) => each.label === "accessible");
    return percent(reached.reduce((sum, each) => sum + each.points, 0), facts.points.total);
  };
  const choice = byId("tool-choice");
  const put = (text, k) => {
    const option = element("option", "", `${text}: ${share(k)}`);
    option.value = String(k);
    choice.append(option);
  };
  put("any of them", ANY_TOOL);
  facts.tools.forEach((tool, k) => put(tool.name, k));
  choice.addEventListener("change", () => chosen(Number(choice.value)));
  byId("tool").hidden = false;
}

// Whether direction and score of a point are those of the tool that is asked for.
function standsFor(point, chosen) { return chosen === ANY_TOOL || chosen === point.tool || point.tools.length === 0; }

// Why the chosen tool is not shown in place.
function toolsLine(point, facts, chosen) {
  const names = (list) => list.map((k) => facts.tools[k].name).join(", ");
  if (!point.tools.includes(chosen)) return `Choose ${names(point.tools)} above to see it in place.`;
  return `The result has one way in for each point, that of the first tool that reaches it: choose ${facts.tools[point.tool].name} ` +
      `above to see it. ${facts.tools[chosen].name} reaches the point, too.`;
}
