// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Tables by what the returns carried: one row per tree or class, sorted by a click on a column; a click on a row shows
// where its points are.

const TABLE_COLUMNS = [
  {name: "", value: (row) => row.id === null ? Infinity : row.id, text: (row) => row.id === null ? "none" : String(row.id)},
  {name: "points", value: (row) => row.points, text: (row) => grouped(row.points)},
  {name: "area", value: (row) => row.area_m2, text: (row) => areaText(row.area_m2)},
  {name: "reached", title: "share of the area that can be reached", value: (row) => reachableShare(row), text: (row) => percent(row.reasons_m2.none || 0, row.area_m2)},
  {name: "stopped by", title: "what stops the tool on most of the area", value: (row) => REASON_ORDER.indexOf(mainReason(row)),
   text: (row) => mainReason(row) ? REASON_WORDS[mainReason(row)].short : "", reason: mainReason},
  {name: "height", value: (row) => heightOf(row), text: (row) => heightOf(row).toFixed(1) + "\u202fm"},
];

function reachableShare(row) { return row.area_m2 > 0 ? (row.reasons_m2.none || 0) / row.area_m2 : 0; }
function heightOf(row) { return row.high[2] - row.low[2]; }
function mainReason(row) {
  const stopped = Object.entries(row.reasons_m2).filter(([reason]) => reason !== "none");
  return stopped.reduce((most, each) => each[1] > most[1] ? each : most, [null, 0])[0];
}

// @param shown  called with a row whose points are to be looked at
// @param sorting  a Map that keeps, from call to call, by which column each table is sorted, and which row was chosen last
function fillTables(facts, sorting, shown) {
  byId("tables").replaceChildren();
  for (const table of facts.tables || []) {
    const columns = TABLE_COLUMNS.map((column, n) => n > 0 ? column : {...column, name: table.attribute});
    const body = element("tbody");
    let {by, up} = sorting.get(table.attribute) || {by: 0, up: true};
    const fill = () => {
      sorting.set(table.attribute, {by, up});
      const value = columns[by].value;
      const rows = [...table.rows].sort((a, b) => (value(a) < value(b) ? -1 : value(a) > value(b) ? 1 : 0) * (up ? 1 : -1));
      body.replaceChildren(...rows.map((row) => {
        const line = element("tr", "", ...columns.map((column) => {
          const reason = column.reason && column.reason(row);
          const cell = element("td", "", ...(reason ? [swatch(REASON_COLOURS[reason])] : []), column.text(row));
          if (reason) cell.title = REASON_WORDS[reason].name;
          return cell;
        }));
        line.tabIndex = 0;
        const {shown: last} = sorting;
        line.setAttribute("aria-selected", String(Boolean(last) && last.attribute === table.attribute && last.id === row.id));
        const show = () => {
          sorting.shown = {attribute: table.attribute, id: row.id};
          for (const other of byId("tables").querySelectorAll("tbody tr")) other.setAttribute("aria-selected", String(other === line));
          shown(row);
        };
        line.addEventListener("click", show);
        line.addEventListener("keydown", (event) => { if (event.key === "Enter") show(); });
        return line;
      }));
    };
    const heads = columns.map((column, n) => {
      const button = element("button", "", column.name);
      button.type = "button";
      if (column.title) button.title = column.title;
      button.addEventListener("click", () => {
        up = by === n ? !up : n === 0;  // numbers begin with the largest
        by = n;
        fill();
      });
      return element("th", "", button);
    });
    fill();
    const more = table.rows_total - table.rows.length;
    byId("tables").append(
        element("h2", "", `By ${table.attribute}`),
        element("div", "rows", element("table", "", element("thead", "", element("tr", "", ...heads)), body)),
        element("p", "quiet", (more > 0 ? `The ${grouped(table.rows.length)} largest; ${grouped(more)} more are in table.csv. ` : "") +
            "Click a row to see where it is, a column to sort by it."));
    byId("tables").hidden = false;
  }
}
