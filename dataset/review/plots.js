// The signals over time around an event, one above the other over one axis of time.

import { byId, clock, marks, minus, placeOf, seconds, shape, trace } from "./elements.js";

const LEFT = 60;
const RIGHT = 14;
const HEAD = 18;
const GAP = 6;
const LANE = 20;
const AXIS = 34;
const LEAST_HEIGHT = 44;

const number1 = (value) => (Math.abs(value) < 0.05 ? "0.0" : minus(value.toFixed(1)));

export class Plots {
  // `moved` is called with a time when somebody points at one; `dragged` with an edge and its new time.
  constructor(host, panels, moved, dragged) {
    this.host = host;
    this.panels = panels;
    this.moved = moved;
    this.dragged = dragged;
    host.addEventListener("pointerdown", (event) => this.grab(event));
  }

  // `scene`: view {start, stop}, signals, lanes [{name, rows}], chosen, cursor, mark.
  draw(scene) {
    this.scene = scene;
    const { view, signals, chosen } = scene;
    const width = Math.max(320, this.host.clientWidth);
    const shown = this.panels.filter((panel) => signals && panel.lines.some((line) => line.column in signals.columns));
    const absent = this.panels.filter((panel) => !shown.includes(panel));
    const room = this.host.clientHeight - AXIS - scene.lanes.length * LANE - (absent.length ? 16 : 0);
    const height = Math.max(LEAST_HEIGHT, Math.floor(room / Math.max(shown.length, 1)) - HEAD - GAP);
    this.x = (time) => LEFT + ((width - LEFT - RIGHT) * (time - view.start)) / (view.stop - view.start);
    this.width = width;
    const bottom = shown.length * (HEAD + height + GAP);
    const total = bottom + scene.lanes.length * LANE + AXIS + (absent.length ? 16 : 0);
    const drawing = shape("svg", { viewBox: `0 0 ${width} ${total}`, width, height: total });
    if (chosen) drawing.append(this.zone(chosen, bottom));
    this.readings = shown.map((panel, number) => this.panel(drawing, panel, number * (HEAD + height + GAP), height));
    scene.lanes.forEach((lane, number) => this.lane(drawing, lane, bottom + number * LANE));
    this.axis(drawing, bottom + scene.lanes.length * LANE);
    if (chosen) this.edges(drawing, chosen, bottom);
    if (scene.mark !== null) {
      const at = this.x(scene.mark);
      drawing.append(shape("line", { class: "mark", x1: at, x2: at, y1: 0, y2: bottom }));
    }
    this.line = shape("line", { class: "cursor", y1: 0, y2: bottom });
    drawing.append(this.line);
    if (absent.length) {
      const names = absent.map((panel) => panel.title.split(",")[0].toLowerCase()).join(", ");
      const said = signals ? `Not in this stretch: ${names}` : "No synced table of this recording; `wheelprint convert` makes it.";
      drawing.append(shape("text", { class: "quiet", x: LEFT, y: total - 4 }, said));
    }
    this.host.replaceChildren(drawing);
    this.point(scene.cursor);
  }

  zone(chosen, bottom) {
    const [from, to] = [chosen.start, chosen.stop].map(this.x);
    return shape("rect", { class: `zone ${chosen.decision}`, x: from, y: 0, width: Math.max(1, to - from), height: bottom });
  }

  edges(drawing, chosen, bottom) {
    for (const edge of ["start", "stop"]) {
      const at = this.x(chosen[edge]);
      drawing.append(
        shape("line", { class: `edge ${chosen.decision}`, x1: at, x2: at, y1: 0, y2: bottom }),
        shape("rect", { class: "handle", "data-edge": edge, x: at - 5, y: 0, width: 10, height: bottom }, shape("title", {}, `${edge} of the stretch: drag, or keys`)),
      );
    }
  }

  panel(drawing, panel, top, height) {
    const { view, signals } = this.scene;
    const lines = panel.lines.filter((line) => line.column in signals.columns);
    const columns = lines.map((line) => signals.columns[line.column].map((value) => (value === null ? null : value * panel.factor)));
    const values = columns.flat().filter((value) => value !== null);
    let low = values.reduce((least, value) => Math.min(least, value), panel.least[0]);
    let high = values.reduce((greatest, value) => Math.max(greatest, value), panel.least[1]);
    [low, high] = [low - 0.04 * (high - low), high + 0.04 * (high - low)];
    const y = (value) => top + HEAD + height - (height * (value - low)) / (high - low);
    const right = this.width - RIGHT;

    drawing.append(shape("text", { class: "panel-title", x: LEFT, y: top + 14 }, `${panel.title} (${panel.unit})`));
    for (const [value, label] of marks(low, high, Math.max(3, Math.floor(height / 17)))) {
      const at = y(value);
      drawing.append(
        shape("line", { class: value === 0 ? "grid zero" : "grid", x1: LEFT, x2: right, y1: at, y2: at }),
        shape("text", { class: "tick", x: LEFT - 6, y: at + 4, "text-anchor": "end" }, label),
      );
    }
    for (const limit of this.limits(panel).filter((value) => value > low && value < high)) {
      const text = `threshold ${minus(String(Number(limit.toPrecision(3))))}`;
      drawing.append(
        shape("line", { class: "limit", x1: LEFT, x2: right, y1: y(limit), y2: y(limit) }),
        shape("text", { class: "limit-label", x: LEFT + 4, y: y(limit) + (limit < 0 || y(limit) < top + HEAD + 14 ? 11 : -3) }, text),
      );
    }
    const xs = signals.time.map((time) => this.x(view.start + time));
    const clip = `clip-${panel.lines[0].column}`;
    drawing.append(shape("clipPath", { id: clip }, shape("rect", { x: LEFT, y: top, width: right - LEFT, height: HEAD + height })));
    columns.forEach((column, number) => {
      const path = trace(xs, column.map((value) => (value === null ? null : y(value))));
      drawing.append(shape("path", { class: `trace ${lines[number].name}`, d: path, "clip-path": `url(#${clip})` }));
    });
    const reading = shape("text", { class: "reading", x: right, y: top + 14, "text-anchor": "end" });
    drawing.append(reading);
    return { reading, lines, columns };
  }

  // The thresholds that the chosen event was found with, else those of the project file.
  limits(panel) {
    const { chosen } = this.scene;
    const own = panel.lines.filter((line) => chosen?.limits && line.column in chosen.limits).map((line) => chosen.limits[line.column] * panel.factor);
    const isOfBothSides = panel.limits.length > 0 && panel.limits.every((limit) => panel.limits.includes(-limit));
    return own.length ? [...new Set(own.flatMap((limit) => (isOfBothSides ? [limit, -limit] : [limit])))] : panel.limits;
  }

  lane(drawing, lane, top) {
    drawing.append(shape("text", { class: "tick", x: LEFT - 6, y: top + 13, "text-anchor": "end" }, lane.name));
    for (const row of lane.rows) {
      const from = Math.max(LEFT, this.x(row.start));
      const to = Math.min(this.width - RIGHT, this.x(row.stop));
      if (to <= from) continue;
      const group = shape("svg", { x: from, y: top + 2, width: Math.max(2, to - from), height: LANE - 4, class: `bar ${row.decision}` });
      group.append(shape("rect", { width: "100%", height: "100%", rx: 2 }), shape("text", { x: 4, y: 12 }, row.label));
      group.append(shape("title", {}, `${row.label}, ${row.decision}`));
      drawing.append(group);
    }
  }

  axis(drawing, top) {
    const { view, chosen } = this.scene;
    const zero = chosen ? chosen.start : view.start;
    const wanted = Math.max(3, Math.floor((this.width - LEFT - RIGHT) / 55));
    for (const [value, label] of marks((view.start - zero) / 1000, (view.stop - zero) / 1000, wanted)) {
      const at = this.x(zero + value * 1000);
      drawing.append(
        shape("line", { class: "grid", x1: at, x2: at, y1: top, y2: top + 4 }),
        shape("text", { class: "tick", x: at, y: top + 16, "text-anchor": "middle" }, label),
      );
    }
    const name = chosen ? "time from the start of the stretch (s)" : `time from ${clock(zero)} UTC (s)`;
    drawing.append(shape("text", { class: "tick", x: (LEFT + this.width - RIGHT) / 2, y: top + 30, "text-anchor": "middle" }, name));
  }

  // Draw the cursor and what is read off there, without drawing anything else again.
  point(cursor) {
    if (!this.line) return;
    this.scene.cursor = cursor;
    const { view, signals } = this.scene;
    const at = this.x(cursor);
    this.line.setAttribute("x1", at);
    this.line.setAttribute("x2", at);
    const row = signals ? placeOf(signals.time, cursor - view.start + 1) : -1;
    for (const { reading, lines, columns } of this.readings) {
      const parts = lines.map((line, number) => {
        const value = row < 0 ? null : columns[number][row];
        return shape("tspan", { class: `value ${line.name}`, dx: number ? 10 : 0 }, `${line.name} ${value === null || value === undefined ? "–" : number1(value)}`);
      });
      reading.replaceChildren(...parts);
    }
  }

  timeAt(event) {
    const { view } = this.scene;
    const place = event.clientX - this.host.getBoundingClientRect().left;
    const share = (place - LEFT) / (this.width - LEFT - RIGHT);
    const time = view.start + share * (view.stop - view.start);
    return Math.round(Math.min(Math.max(time, view.start), view.stop) / 100) * 100;
  }

  grab(event) {
    if (!this.scene || event.button !== 0) return;
    const edge = event.target.dataset?.edge;
    const handle = event.target;
    let isDragged = false;
    const follow = (moved) => {
      isDragged ||= Math.abs(moved.clientX - event.clientX) > 3;
      this.moved(this.timeAt(moved));
      if (edge) handle.setAttribute("x", this.x(this.timeAt(moved)) - 5);
    };
    const drop = (moved) => {
      removeEventListener("pointermove", follow);
      removeEventListener("pointerup", drop);
      if (edge && isDragged) this.dragged(edge, this.timeAt(moved));
    };
    addEventListener("pointermove", follow);
    addEventListener("pointerup", drop);
    event.preventDefault();
    if (!edge) follow(event);
  }
}

// The whole recording: its speed, everything that is marked in it, and where the view is.
export class Timeline {
  constructor(host, moved) {
    this.host = host;
    host.addEventListener("pointerdown", (event) => {
      if (!this.outline) return;
      const { left, width } = this.host.getBoundingClientRect();
      const share = (event.clientX - left) / width;
      moved(Math.round((this.outline.start + share * (this.outline.stop - this.outline.start)) / 100) * 100);
    });
  }

  draw(outline, rows, view, chosen) {
    this.outline = outline;
    if (!outline || outline.start === null) {
      this.host.replaceChildren();
      return;
    }
    const width = Math.max(320, this.host.clientWidth);
    const x = (time) => (width * (time - outline.start)) / (outline.stop - outline.start);
    const drawing = shape("svg", { viewBox: `0 0 ${width} 64`, width, height: 64 });
    if (outline.speed) {
      const most = outline.speed.reduce((greatest, value) => Math.max(greatest, value ?? 0), 1);
      const path = trace(outline.time.map(x), outline.speed.map((value) => (value === null ? null : 44 - (30 * value) / most)));
      drawing.append(shape("path", { class: "trace whole", d: path }), shape("text", { class: "tick", x: 2, y: 9 }, `speed, up to ${(3.6 * most).toFixed(0)} km/h`));
    }
    for (const row of rows) {
      const bar = shape("rect", { class: `bar ${row.decision}`, x: x(row.start), y: row === chosen ? 12 : 16, width: Math.max(2, x(row.stop) - x(row.start)), height: row === chosen ? 33 : 29 });
      bar.append(shape("title", {}, `${row.label}, ${row.decision}, ${clock(row.start)}`));
      drawing.append(bar);
    }
    drawing.append(shape("rect", { class: "view", x: x(view.start), y: 12, width: Math.max(4, x(view.stop) - x(view.start)), height: 34, rx: 3 }));
    for (const [value, label] of marks(0, (outline.stop - outline.start) / 60000, Math.floor(width / 80))) {
      const at = x(outline.start + value * 60000);
      if (at < width - 80) drawing.append(shape("text", { class: "tick", x: at, y: 60, "text-anchor": value ? "middle" : "start" }, label));
    }
    drawing.append(shape("text", { class: "tick", x: width - 2, y: 60, "text-anchor": "end" }, "time (min)"));
    this.host.replaceChildren(drawing);
  }
}

export const span = (row) => `${seconds(row.stop - row.start)} s`;
export const labelled = (id, text) => byId(id).replaceChildren(text);
