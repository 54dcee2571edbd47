// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Puts the parts together: what is shown, what is selected, and the address that says so.

class Report {
  constructor(facts) {
    this.facts = facts;
    this.canvas = byId("view");
    this.points = new Points(facts);
    this.camera = new Camera({low: [-1, -1, -1], high: [1, 1, 1]});
    this.mode = 0;
    this.hidden = 0;  // one bit per reason
    this.selected = -1;
    this.tools = [];       // unpacked; null where one is not in the page
    this.chosen = ANY_TOOL;
    this.sorting = new Map();
    this.arrows = [];      // of each tool
    this.target = -1;      // of facts.approaches; then nothing is selected
    this.way = 0;          // its approach
    this.pose = CONTACT;   // index in POSES
    this.target_buttons = facts.approaches ? fillTargets(facts, (n) => this.goToTarget(n)) : [];
    this.view = -1;        // of facts.views; then nothing is selected
    this.view_buttons = facts.views ? fillViews(facts, (n) => this.goToView(n)) : [];
    this.pins = [];        // Pins with what is current among them
    this.ready = false;  // the first picture was drawn
    this.frame_due = false;
    fillTools(facts, (chosen) => this.choose(chosen));
    this.fillColumn();
    fillProblems(facts);
    fillRun(facts);
  }

  // What depends on the chosen tool.
  fillColumn() {
    const facts = factsFor(this.facts, this.chosen);
    this.chips = fillChips(facts, (reason, alone) => this.toggle(reason, alone));
    fillSummary(facts, this.chosen);
    fillAreas(facts);
    fillTables(facts, this.sorting, (row) => this.look(row));
  }

  async start() {
    const begin = performance.now();
    if (typeof DecompressionStream === "undefined") {
      throw new Error("this browser is too old: it needs Chrome 80, Firefox 113, Safari 16.4 or newer");
    }
    this.painter = new Painter(this.canvas, this.points);
    this.resize();
    this.painter.warmUp(this.camera);
    this.buildToolbar();
    steer(this.canvas, this.camera, {
      changed: () => this.moved(),
      clicked: (x, y) => this.select(pointAt(this.points, this.camera, this.painter, this.hidden, x, y)),
      centred: (x, y) => this.centre(x, y),
    });
    this.watchPage();
    for (const {drawn} of this.facts.tools || [{drawn: this.facts.tool}]) {
      this.tools.push(drawn ? await Tool.unpack(drawn) : null);
    }
    await this.unpackAll();
    this.painter.upload();
    if (this.facts.approaches) this.drawArrows();
    // The top of a tall tree is a small share of a plot.
    this.camera.home = this.points.usualBox(0.002);
    const most = this.points.usualBox(0.02);
    this.painter.heights = [most.low[2], most.high[2]];
    this.resize();
    this.camera.fit();
    if (this.facts.views) this.drawViews();
    this.readAddress();
    this.paint();
    this.painter.finish();
    this.ready = true;
    this.settle();
    byId("message").hidden = true;
    const page = document.documentElement.dataset;
    page.drawn = this.painter.uploaded;
    page.unpackMs = Math.round(performance.now() - begin);
    page.pictureMs = Math.round(performance.now());
    page.state = "ready";
  }

  async unpackAll() {
    const texts = document.querySelectorAll("script.points");
    if (texts.length !== this.facts.blocks.length) throw new Error("the file is not complete");
    for (let n = 0; n < texts.length; ++n) {
      await this.points.unpack(this.facts.blocks[n], texts[n].textContent);
      texts[n].remove();  // frees its memory
      byId("message").textContent = `Reading points: ${percent(this.points.count, this.facts.points.drawn)}`;
    }
    if (this.points.count !== this.facts.points.drawn) throw new Error("the file is not complete");
  }

  // Pictures -----------------------------------------------------------------------------------------------------------

  resize() {
    const box = this.canvas.getBoundingClientRect(), ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.camera.resize(box.width, box.height);
    const width = Math.max(1, Math.round(box.width * ratio)), height = Math.max(1, Math.round(box.height * ratio));
    if (this.canvas.width === width && this.canvas.height === height) return;  // setting them would clear it
    this.canvas.width = width;
    this.canvas.height = height;
  }

  paint(finer = 1) {
    this.painter.draw(this.camera, {mode: this.mode, hidden: this.hidden}, finer);
    this.placeRing();
    const taken = [];
    for (const {pins, current} of this.pins) pins.place(this.camera, current(), taken);
    this.drawScale();
  }

  // Draws soon.
  moved() {
    if (!this.ready) return;
    if (!this.frame_due) {
      this.frame_due = true;
      requestAnimationFrame(() => {
        this.frame_due = false;
        this.paint();
      });
    }
    this.settle();
  }

  // Smooth edges follow once nothing has changed for a moment.
  settle() {
    clearTimeout(this.settling);
    this.settling = setTimeout(() => {
      this.paint(2);
      this.writeAddress();
    }, 250);
  }

  placeRing() {
    const ring = byId("ring");
    const place = this.selected >= 0 ? this.points.local(this.selected)
        : this.target >= 0 ? this.localOf(this.facts.approaches.targets[this.target].position)
        : this.view >= 0 ? this.localOf(this.facts.views.views[this.view].pose.slice(0, 3)) : null;
    const at = place && this.camera.toPixels(place);
    ring.hidden = !at;
    if (!at) return;
    ring.style.left = `${at[0]}px`;
    ring.style.top = `${at[1]}px`;
  }

  // 1, 2 or 5 times a power of ten metres, at the distance of what the camera turns around.
  drawScale() {
    const metres_per_px = this.camera.distance / this.camera.focal_px(), wanted_m = 120 * metres_per_px;
    const decade = 10 ** Math.floor(Math.log10(wanted_m));
    const length_m = [5, 2, 1].map((factor) => factor * decade).find((length) => length <= wanted_m) || decade;
    byId("scale-bar").style.width = `${length_m / metres_per_px}px`;
    byId("scale-text").textContent = lengthText(length_m);
  }

  // Choices ------------------------------------------------------------------------------------------------------------

  buildToolbar() {
    this.mode_buttons = COLOUR_MODES.map(({name, key}, mode) => {
      const button = element("button", "", name);
      button.type = "button";
      button.dataset.mode = key;
      button.hidden = key === "margin" && widestMargin(this.facts) === 0 || key === "probability" && !hasProbability(this.facts);
      button.setAttribute("role", "radio");
      button.addEventListener("click", () => this.setMode(mode));
      return button;
    });
    byId("colours").append(...this.mode_buttons);
    this.setMode(0);
    byId("fit").addEventListener("click", () => this.fit());
    byId("top").addEventListener("click", () => this.lookFromAbove());
    byId("print").addEventListener("click", () => window.print());
    byId("link").addEventListener("click", () => this.copyLink());
  }

  setMode(mode) {
    this.mode = mode;
    this.mode_buttons.forEach((button, n) => button.setAttribute("aria-checked", String(n === mode)));
    const legend = byId("legend"), parts = this.legend(COLOUR_MODES[mode].key);
    legend.hidden = parts.length === 0;
    legend.replaceChildren(...parts);
    this.moved();
  }

  // What the colours mean; nothing for reasons, which the column lists.
  legend(key) {
    const ramp = () => element("span", "ramp");
    const metres = (height) => fixed(height + this.points.anchor_W[2], 1) + "\u202fm";
    if (key === "confidence") return ["0", ramp(), "1"];
    if (key === "probability") return ["0\u202f%", ramp(), "100\u202f%"];
    if (key === "height") return [metres(this.painter.heights[0]), ramp(), metres(this.painter.heights[1])];
    if (key === "margin") return ["0", ramp(), `${fixed(widestMargin(this.facts), 3)}\u202fm of room`];
    if (key !== "label") return [];
    return ["accessible", "blocked", "unscored"].map(
        (label) => element("span", "", swatch(LABEL_COLOURS[label]), LABEL_WORDS[label]));
  }

  // @param chosen  index of one of several tools, or ANY_TOOL
  choose(chosen) {
    if (chosen === this.chosen) return;
    this.chosen = chosen;
    byId("tool-choice").value = String(chosen);
    byId("tool-note").hidden = chosen === ANY_TOOL;
    this.points.showTool(chosen);
    this.fillColumn();
    this.showHidden();
    const within = this.painter.within;
    if (this.target >= 0) this.showApproach(this.target, this.way, this.pose);
    else if (this.view >= 0) this.showView(this.view);
    else this.select(this.selected);
    this.painter.within = within;
  }

  toggle(reason, alone) {
    const bit = 1 << REASONS.indexOf(reason), others = (1 << REASONS.length) - 1 & ~bit;
    if (alone) this.hidden = this.hidden === others ? 0 : others;
    else this.hidden ^= bit;
    this.showHidden();
    this.moved();
  }

  showHidden() {
    for (const [reason, chip] of this.chips) {
      chip.setAttribute("aria-pressed", String((this.hidden >> REASONS.indexOf(reason) & 1) === 0));
    }
  }

  fit() {
    this.painter.within = null;
    this.camera.fit();
    this.moved();
  }

  // At the box of a row of a table; what is outside fades, until something else is chosen. "Fit" shows everything again.
  look({low, high}) {
    this.select(-1);
    const home = this.camera.home, anchor = this.points.anchor_W, rim = this.facts.frame.voxel_size_m;
    this.camera.home = {low: subtract(low, anchor), high: subtract(high, anchor)};
    this.painter.within = {low: this.camera.home.low.map((value) => value - rim), high: this.camera.home.high.map((value) => value + rim)};
    this.camera.fit();
    this.camera.home = home;
    this.moved();
  }

  lookFromAbove() {
    this.camera.elevation = STEEPEST;
    this.camera.azimuth = -Math.PI / 2;
    this.moved();
  }

  centre(x_px, y_px) {
    const index = pointAt(this.points, this.camera, this.painter, this.hidden, x_px, y_px);
    if (index < 0) return;
    this.camera.target = this.points.local(index);
    this.camera.distance = Math.min(this.camera.distance, Math.max(0.5 * this.camera.distance, 40 * this.painter.disc_m()));
    this.moved();
  }

  // A point ------------------------------------------------------------------------------------------------------------

  // @param index  -1 for none
  select(index) {
    this.clear();
    this.selected = index;
    if (index < 0) {
      byId("card").hidden = true;
    } else {
      const point = this.points.describe(index);
      const tool = this.tools[point.tool] || null, in_place = point.direction_W && (!point.tools || standsFor(point, this.chosen));
      const inside = in_place ? this.showDirection(index, point, tool) : 0;
      this.painter.marked = inside;
      fillCard(byId("card"), {point, facts: this.facts, chosen: this.chosen, tool, inside, targets: this.targetsAt(point),
                             go: (n) => this.goToTarget(n), close: () => this.select(-1)});
    }
    this.painter.uploadMarks();
    this.moved();
  }

  clear() {
    this.selected = -1;
    this.target = -1;
    this.view = -1;
    this.painter.solids = [];
    for (const solid of this.painter.standing) solid.colour[3] = 1;
    this.painter.within = null;
    this.painter.focus = [0, 0, 0, 0];
    unmark(this.points);
    this.painter.marked = 0;
    for (const button of [...this.target_buttons, ...this.view_buttons]) button.setAttribute("aria-current", "false");
  }

  // The tool with its tip at the point, and an arrow the way it comes. @return drawn points inside the tool
  showDirection(index, point, tool) {
    const painter = this.painter, origin = this.points.local(index), out = frameAlong(point.direction_W, point.up_W);
    const length_m = tool ? 1.6 * tool.reach_m : 24 * this.facts.frame.voxel_size_m;
    const arrow = this.arrows[point.tool] ||= arrowMesh(painter, length_m);
    painter.focus = [...origin, 1.3 * length_m];
    const inwards = {x: scaled(out.x, -1), y: scaled(out.y, -1), z: out.z};
    const from = add(origin, scaled(out.x, length_m));
    painter.solids.push({mesh: arrow, placed: frameMatrix(inwards, from), colour: [0.13, 0.15, 0.19, 1]});
    if (!tool) return 0;
    return this.placeTool(tool, out, origin);
  }

  // @return drawn points inside it
  placeTool(tool, frame, origin) {
    tool.mesh ||= this.painter.mesh(tool.vertices, tool.triangles);
    this.painter.solids.push({mesh: tool.mesh, placed: frameMatrix(frame, origin), colour: [0.27, 0.33, 0.62, 0.5]});
    return tool.mark(this.points, frame, origin);
  }

  // Approaches ---------------------------------------------------------------------------------------------------------

  localOf(place_W) { return subtract(place_W, this.points.anchor_W); }

  targetsAt(point) {
    const {targets} = this.facts.approaches || {targets: []};
    return [...targets.keys()].filter((n) => targets[n].point === point.id && targets[n].tile === point.tile);
  }

  arrowsOf(approaches, colour) {
    const ways = approaches.map((each) => [each.pre_contact, each.contact].map((pose) => this.localOf(pose.slice(0, 3))));
    return {mesh: arrowsMesh(this.painter, ways), placed: frameMatrix({x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1]}, [0, 0, 0]),
            colour: [...colour.map((value) => value / 255), 1], grow_px: 0.7, rim_px: 1.3};
  }

  // All of them: the first of each target over the others.
  drawArrows() {
    const {targets} = this.facts.approaches;
    this.painter.standing = [
      this.arrowsOf(targets.flatMap(({approaches}) => approaches.slice(1)), ARROW_COLOURS.other),
      this.arrowsOf(targets.map(({approaches}) => approaches[0]), ARROW_COLOURS.first),
    ];
    const marks = targets.map(({why, approaches}, n) =>
        ({title: `Target ${n}: ${why}`, place: this.localOf(approaches[0].pre_contact.slice(0, 3))}));
    this.pins.push({pins: new Pins(marks, "", (n) => this.goToTarget(n)), current: () => this.target});
  }

  // Looks at a target's first approach from its side, so that tool and surface are seen apart.
  goToTarget(number) {
    const target = this.facts.approaches.targets[number], out = frameOfPose(target.approaches[0].contact).x;
    this.showApproach(number, 0, CONTACT);
    const aside = Math.abs(out[2]) > 0.9 ? this.camera.azimuth : Math.atan2(out[1], out[0]) + 1.1;
    this.camera.azimuth = aside;
    this.camera.elevation = 0.35;
    this.camera.target = this.localOf(target.position);
    this.camera.distance = 1.7 * this.painter.focus[3];
    this.moved();
  }

  // @param number  of the target  @param way  of its approaches  @param pose  index in POSES
  showApproach(number, way, pose) {
    const target = this.facts.approaches.targets[number], approach = target.approaches[way];
    const tool = target.tool === null ? null : this.tools[target.tool];
    this.clear();
    [this.target, this.way, this.pose] = [number, way, pose];
    const at = approach[POSES[pose].key], reach_m = tool ? 1.6 * tool.reach_m : 24 * this.facts.frame.voxel_size_m;
    this.painter.focus = [...this.localOf(target.position), 1.3 * reach_m];
    for (const solid of this.painter.standing) solid.colour[3] = 0.5;
    approach.arrow ||= this.arrowsOf([approach], ARROW_COLOURS.chosen);
    this.painter.solids.push({...approach.arrow, grow_px: 1.2});
    const inside = tool ? this.placeTool(tool, frameOfPose(at), this.localOf(at.slice(0, 3))) : 0;
    this.painter.marked = inside;
    this.target_buttons[number].setAttribute("aria-current", "true");
    showInList(this.target_buttons[number]);
    fillApproachCard(byId("card"), {facts: this.facts, number, way, pose, tool, inside, close: () => this.select(-1),
                                    show: (other_way, other_pose) => this.showApproach(number, other_way, other_pose)});
    this.painter.uploadMarks();
    this.moved();
  }

  // Views --------------------------------------------------------------------------------------------------------------

  // Others are smaller than the first, which one at the same place would hide.
  pyramidsOf(views, colour, share = 1) {
    const poses = views.map(({pose}) => [...this.localOf(pose.slice(0, 3)), ...pose.slice(3)]);
    return {mesh: pyramidsMesh(this.painter, poses, share * this.view_size_m),
            placed: frameMatrix({x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1]}, [0, 0, 0]),
            colour: [...colour.map((value) => value / 255), 1], grow_px: 0.7, rim_px: 1.3};
  }

  drawViews() {
    const {views} = this.facts.views;
    this.view_size_m = viewSize_m(views, this.camera.radius);
    this.painter.standing = [...this.painter.standing, this.pyramidsOf(views.slice(1), VIEW_COLOURS.other, 0.8),
                             this.pyramidsOf(views.slice(0, 1), VIEW_COLOURS.first)];
    const marks = views.map(({resolves, pose}, n) =>
        ({title: `View ${n}: resolves about ${grouped(resolves)} points`, place: this.localOf(pose.slice(0, 3))}));
    this.pins.push({pins: new Pins(marks, "of-view", (n) => this.goToView(n)), current: () => this.view});
  }

  // Looks at a view from where the camera is, nearer.
  goToView(number) {
    this.showView(number);
    this.camera.target = this.localOf(this.facts.views.views[number].pose.slice(0, 3));
    this.camera.distance = 16 * this.view_size_m;
    this.moved();
  }

  showView(number) {
    this.select(-1);
    this.view = number;
    const view = this.facts.views.views[number];
    view.pyramid ||= this.pyramidsOf([view], VIEW_COLOURS.chosen);
    this.painter.solids.push({...view.pyramid, grow_px: 1.2});
    this.view_buttons[number].setAttribute("aria-current", "true");
    showInList(this.view_buttons[number]);
    this.moved();
  }

  // The address --------------------------------------------------------------------------------------------------------

  address() {
    const parts = new URLSearchParams();
    parts.set("view", this.camera.text(this.points.anchor_W));
    parts.set("colour", COLOUR_MODES[this.mode].key);
    if (this.chosen !== ANY_TOOL) parts.set("tool", this.facts.tools[this.chosen].name);
    const hidden = REASONS.filter((_, bit) => this.hidden >> bit & 1);
    if (hidden.length > 0) parts.set("hide", hidden.join(","));
    if (this.selected >= 0) {
      const {tile, id} = this.points.describe(this.selected);
      parts.set("point", tile ? `${tile}:${id}` : String(id));
    }
    if (this.target >= 0) {
      parts.set("target", this.target);
      parts.set("approach", this.way);
      parts.set("pose", POSES[this.pose].key);
    }
    if (this.view >= 0) parts.set("next", this.view);
    return "#" + parts.toString().replaceAll("%2C", ",").replaceAll("%3A", ":");
  }

  writeAddress() {
    if (document.documentElement.dataset.state !== "ready") return;
    this.written = this.address();
    history.replaceState(null, "", this.written);
  }

  readAddress() {
    const parts = new URLSearchParams(location.hash.slice(1));
    if (parts.has("view")) this.camera.read(parts.get("view"), this.points.anchor_W);
    this.choose((this.facts.tools || []).findIndex(({name}) => name === parts.get("tool")));
    const mode = COLOUR_MODES.findIndex(({key}) => key === parts.get("colour"));
    const hidden = (parts.get("hide") || "").split(",").map((reason) => REASONS.indexOf(reason));
    this.hidden = hidden.reduce((bits, bit) => bit < 0 ? bits : bits | 1 << bit, 0);
    this.showHidden();
    this.setMode(Math.max(mode, 0));
    const [, tile, id] = /^(?:(.*):)?(\d+)$/.exec(parts.get("point") || "") || [];
    this.select(id === undefined ? -1 : this.points.find(tile || "", Number(id)));
    this.readApproach(parts);
    this.readView(parts);
  }

  readApproach(parts) {
    const number = (name) => /^\d+$/.test(parts.get(name) || "") ? Number(parts.get(name)) : -1;
    const {targets} = this.facts.approaches || {targets: []}, target = targets[number("target")];
    if (!target) return;
    const pose = POSES.findIndex(({key}) => key === parts.get("pose"));
    const way = target.approaches[number("approach")] ? number("approach") : 0;
    if (!parts.has("view")) this.goToTarget(number("target"));
    this.showApproach(number("target"), way, pose < 0 ? CONTACT : pose);
  }

  readView(parts) {
    const {views} = this.facts.views || {views: []}, number = /^\d+$/.test(parts.get("next") || "") ? Number(parts.get("next")) : -1;
    if (!views[number]) return;
    if (parts.has("view")) this.showView(number);
    else this.goToView(number);
  }

  async copyLink() {
    this.writeAddress();
    const button = byId("link");
    try {
      await navigator.clipboard.writeText(location.href);
      button.textContent = "Copied";
    } catch {
      button.textContent = "See the address bar";
    }
    setTimeout(() => { button.textContent = "Copy link"; }, 1500);
  }

  // The page -----------------------------------------------------------------------------------------------------------

  watchPage() {
    new ResizeObserver(() => {
      this.resize();
      this.moved();
    }).observe(byId("stage"));
    window.addEventListener("hashchange", () => {
      if (location.hash !== this.written) this.readAddress();
    });
    window.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key === "Escape") this.select(-1);
      if (event.key === "f" || event.key === "F") this.fit();
      if (event.key === "t" || event.key === "T") this.lookFromAbove();
    });
    this.canvas.addEventListener("webglcontextlost", () => showFailure("the graphics driver gave up; reload the page"));
    // A canvas prints empty, so paper gets a picture of it, with everything unfolded.
    window.addEventListener("beforeprint", () => {
      this.paint(2);
      byId("print-picture").src = this.canvas.toDataURL("image/png");
      document.querySelectorAll("#panel details:not(#reading)").forEach((each) => {
        each.dataset.wasOpen = each.open;
        each.open = true;
      });
    });
    window.addEventListener("afterprint", () => {
      document.querySelectorAll("#panel details:not(#reading)").forEach((each) => { each.open = each.dataset.wasOpen === "true"; });
    });
  }
}

function showFailure(text) {
  const message = byId("message");
  message.hidden = false;
  message.className = "failed";
  message.textContent = `The points cannot be drawn: ${text}.`;
  document.documentElement.dataset.state = "failed";
}

new Report(JSON.parse(byId("facts").textContent)).start().catch((error) => showFailure(error.message));
