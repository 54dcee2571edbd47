// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The column beside the picture: what the run found, and from what.

function sumOf(facts, key, wanted) {
  return facts.classes.filter(wanted).reduce((sum, each) => sum + each[key], 0);
}

// Those in the page, of one tool or several.
function drawnTools(facts) { return (facts.tools || [{drawn: facts.tool}]).map(({drawn}) => drawn).filter(Boolean); }

function byId(id) { return document.getElementById(id); }

// @param chosen  index of one of several tools, or ANY_TOOL
function fillSummary(facts, chosen) {
  const total = facts.points.total, run = facts.run || {};
  const reachable = (each) => each.label === "accessible";
  const header = facts.header || {};
  document.title = `${header.title || facts.name} – accessibility report`;
  byId("title").textContent = header.title || facts.name;
  byId("client").textContent = [header.client, header.site].filter(Boolean).join(" · ");
  byId("client").hidden = byId("client").textContent === "";
  const tool = facts.tools ? facts.tools.map(({name}) => name).join(", ") : facts.metadata.tool || (run.parameters || {}).tool;
  byId("subject").textContent = (tool ? `${facts.tools ? "Tools" : "Tool"} ${tool}, voxels` : "Voxels") +
      ` of ${lengthText(facts.frame.voxel_size_m)}` +
      (facts.tiles > 0 ? `, ${grouped(facts.tiles)} tiles` : "");
  byId("headline").replaceChildren(
      element("b", "", percent(sumOf(facts, "points", reachable), total)),
      ` of the surface points can be reached${chosen === ANY_TOOL ? "" : ` by ${facts.tools[chosen].name}`}: about `,
      element("b", "", areaText(sumOf(facts, "area_m2", reachable))), " of ",
      areaText(sumOf(facts, "area_m2", () => true)));
  const bar = byId("bar");
  bar.replaceChildren();
  for (const reason of REASON_ORDER) {
    const points = sumOf(facts, "points", (each) => each.reason === reason);
    if (points === 0) continue;
    const part = element("span");
    part.style.flexGrow = points;
    part.style.backgroundColor = `rgb(${REASON_COLOURS[reason].join(" ")})`;
    part.title = `${REASON_WORDS[reason].name}: ${percent(points, total)}`;
    bar.append(part);
  }
  bar.setAttribute("aria-label", "Shares of the reasons");
  const {drawn, cell_m} = facts.points;
  byId("drawn").textContent = cell_m > 0
      ? `${grouped(drawn)} of ${grouped(total)} points are drawn: one per reason in each cube of ${lengthText(cell_m)}. ` +
            `The other ${grouped(total - drawn)} are counted, but left out of the picture.`
      : `All ${grouped(total)} points are drawn.`;
}

function fillProblems(facts) {
  const run = facts.run || {};
  const all = [...facts.problems, ...(run.warnings || [])];
  if (run.error && run.error.problem) all.unshift({id: run.error.id || "error", text: `The run failed: ${run.error.problem}`});
  else if (run.exit_code > 0) all.unshift({id: "run.stopped", text: `The run was stopped early (exit code ${run.exit_code}).`});
  if (!facts.run) all.push({id: "report.missing", text: "The folder has no report.json: parameters and inputs are not known."});
  for (const tool of drawnTools(facts)) {
    if (tool.difference && !all.some((each) => each.id === "report.tool")) all.push({id: "report.tool", text: tool.difference});
  }
  if (all.length === 0) return;
  const section = byId("problems");
  section.hidden = false;
  section.append(element("h2", "", all.length === 1 ? "A warning" : "Warnings"),
                 element("ul", "", ...all.map((each) => {
                   const item = element("li", "", each.text);
                   item.title = each.id;
                   return item;
                 })));
}

// @param toggled  called with a reason, and whether it alone is to be shown
function fillChips(facts, toggled) {
  const total = facts.points.total;
  const chips = new Map();
  byId("chips").replaceChildren();
  for (const reason of REASON_ORDER) {
    const of_reason = (each) => each.reason === reason;
    const points = sumOf(facts, "points", of_reason), words = REASON_WORDS[reason];
    // Only maps that let things go, or that judge fewer points, have any; only one of several tools has others.
    if (["changed", "beside_surface", "other"].includes(reason) && points === 0) continue;
    const chip = element("button", "chip",
        element("span", "name", swatch(REASON_COLOURS[reason]), words.name),
        element("span", "count", `${grouped(points)} · ${percent(points, total)} · ${areaText(sumOf(facts, "area_m2", of_reason))}`),
        element("span", "means", words.means),
        element("span", "todo", words.todo));
    chip.type = "button";
    chip.dataset.reason = reason;
    chip.disabled = points === 0;
    chip.addEventListener("click", () => toggled(reason, false));
    const only = element("button", "only", "only");
    only.type = "button";
    only.title = "Show only these";
    only.disabled = points === 0;
    only.addEventListener("click", () => toggled(reason, true));
    byId("chips").append(element("li", "", chip, only));
    chips.set(reason, chip);
  }
  return chips;
}

function fillAreas(facts) {
  const head = element("tr", "", ...["", "points", "share", "area"].map((text) => element("th", "", text)));
  const line = (name, wanted, colour) => {
    const points = sumOf(facts, "points", wanted);
    return element("tr", "", element("th", "", ...(colour ? [swatch(colour)] : []), name),
                   element("td", "", grouped(points)), element("td", "", percent(points, facts.points.total)),
                   element("td", "", areaText(sumOf(facts, "area_m2", wanted))));
  };
  byId("areas").replaceChildren(head, ...["accessible", "blocked", "unscored"].map(
      (label) => line(LABEL_WORDS[label], (each) => each.label === label, LABEL_COLOURS[label])),
      line("all", () => true));
}

function tableOf(pairs) {
  return element("table", "values", ...pairs.map(([name, value]) => row(name, String(value))));
}

function fillRun(facts) {
  const run = facts.run || {}, counts = run.counts || {}, metadata = facts.metadata;
  const pairs = [];
  const put = (name, value) => { if (value !== undefined && value !== null && value !== "") pairs.push([name, value]); };
  put("Program", `AccessVDB ${run.version || metadata.accessvdb_version || ""}`);
  put("Device", run.device);
  put("Scans", counts.scans !== undefined ? grouped(counts.scans) : undefined);
  put("Returns", counts.points_in !== undefined ? `${grouped(counts.points_in)}, ${percent(counts.points_used, counts.points_in)} used` : undefined);
  for (const [reason, count] of Object.entries(run.dropped || {})) {
    if (count > 0) put(`Dropped: ${reason.replaceAll("_", " ")}`, grouped(count));
  }
  const agreement = run.agreement || {};
  if (agreement.agreeing !== undefined) {
    put("Scans agree", `${percent(agreement.agreeing, agreement.agreeing + agreement.contradicting)} of ${grouped(agreement.agreeing + agreement.contradicting)} returns (${agreement.verdict})`);
  } else if (agreement.why_not) {
    put("Scans agree", `not measured: ${agreement.why_not}`);
  }
  if (facts.bounds) {
    const size = subtract(facts.bounds[1], facts.bounds[0]);
    put("Extent", size.map((value) => value.toFixed(1)).join(" × ") + "\u202fm");
  }
  for (const tool of drawnTools(facts)) {
    put(facts.tools ? `Size of ${tool.name}` : "Tool's size", tool.size_m.map((value) => +value.toPrecision(3)).join(" × ") + "\u202fm");
  }
  byId("run-facts").append(tableOf(pairs), element("ul", "notices", ...(run.notices || []).map((text) => element("li", "", text))));
  const parameters = Object.entries(run.parameters || metadata).filter(([, value]) => value !== "" && value !== null);
  byId("parameters").append(tableOf(parameters));
  fillHashes(facts, run);
  byId("made").textContent = "Made by AccessVDB. This page is one file and contacts no other computer.";
}

function fillHashes(facts, run) {
  const list = element("table", "hashes");
  const put = (name, sha256) => list.append(element("tr", "", element("th", "", name), element("td", "", sha256)));
  for (const file of facts.hashes) put(file.path, file.sha256);
  if (facts.metadata.tool_sha256) put(facts.tools ? "tools" : `tool ${facts.metadata.tool || ""}`, facts.metadata.tool_sha256);
  for (const tool of drawnTools(facts)) {
    if (tool.difference) put(`tool drawn here, ${tool.name}`, tool.sha256);
  }
  for (const file of run.inputs || []) put(file.path, file.sha256);
  byId("hashes").append(element("p", "quiet", "SHA-256 of what was read and written."), list);
  const more = (run.inputs_total || 0) - (run.inputs || []).length;
  if (more > 0) byId("hashes").append(element("p", "quiet", `and ${grouped(more)} more, in report.json.`));
}
