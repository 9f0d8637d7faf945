// Where the car went: north up, one scale for both axes.

import { placeOf, shape, trace } from "./elements.js";

const MARGIN = 34;
const LEAST = 15; // m; what stands still is not blown up to fill the map

export class PathMap {
  constructor(host) {
    this.host = host;
  }

  // `signals` hold the path of the view, `outline` that of the whole recording.
  draw(view, signals, outline, chosen, cursor) {
    const [width, height] = [Math.max(240, this.host.clientWidth), Math.max(200, this.host.clientHeight)];
    const drawing = shape("svg", { viewBox: `0 0 ${width} ${height}`, width, height });
    this.view = view;
    this.signals = signals;
    const { x: easts, y: norths } = signals?.columns ?? {};
    this.dot = null;
    if (!easts || !norths) {
      drawing.append(shape("text", { class: "quiet", x: width / 2, y: height / 2, "text-anchor": "middle" }, "No position in this stretch"));
      this.host.replaceChildren(drawing);
      return;
    }
    const [west, east] = extent(easts);
    const [south, north] = extent(norths);
    const scale = Math.min((width - 2 * MARGIN) / Math.max(east - west, LEAST), (height - 2 * MARGIN) / Math.max(north - south, LEAST));
    this.place = (one, other) => [width / 2 + scale * (one - (west + east) / 2), height / 2 - scale * (other - (south + north) / 2)];
    const path = (xs, ys) => {
      const places = xs.map((value, row) => (value === null || ys[row] === null ? [null, null] : this.place(value, ys[row])));
      return trace(places.map((place) => place[0]), places.map((place) => place[1]));
    };
    if (outline?.x && outline?.y) drawing.append(shape("path", { class: "path whole", d: path(outline.x, outline.y) }));
    drawing.append(shape("path", { class: "path around", d: path(easts, norths) }));
    if (chosen) {
      const first = Math.max(0, placeOf(signals.time, chosen.start - view.start - 1));
      const last = placeOf(signals.time, chosen.stop - view.start) + 1;
      drawing.append(shape("path", { class: `path chosen ${chosen.decision}`, d: path(easts.slice(first, last), norths.slice(first, last)) }));
    }
    this.arrows(drawing, easts, norths);
    const start = easts.findIndex((value) => value !== null);
    const [startX, startY] = this.place(easts[start], norths[start]);
    drawing.append(shape("circle", { class: "begin", cx: startX, cy: startY, r: 4 }, shape("title", {}, "the view begins here")));
    this.bar(drawing, scale, width, height);
    drawing.append(
      shape("path", { class: "north", d: `M${width - 20} 36V14m-5 8l5 -8l5 8` }),
      shape("text", { class: "tick", x: width - 20, y: 50, "text-anchor": "middle" }, "N"),
    );
    this.dot = shape("circle", { class: "dot", r: 6 });
    drawing.append(this.dot);
    this.host.replaceChildren(drawing);
    this.point(cursor);
  }

  // Which way it went, every hundred pixels or so.
  arrows(drawing, easts, norths) {
    let way = 50;
    let last = null;
    easts.forEach((value, row) => {
      if (value === null || norths[row] === null) {
        last = null;
        return;
      }
      const place = this.place(value, norths[row]);
      if (last) {
        const step = Math.hypot(place[0] - last[0], place[1] - last[1]);
        way += step;
        if (way > 100 && step > 0.3) {
          way = 0;
          const angle = (Math.atan2(place[1] - last[1], place[0] - last[0]) * 180) / Math.PI;
          const turn = `translate(${place[0].toFixed(1)} ${place[1].toFixed(1)}) rotate(${angle.toFixed(0)})`;
          drawing.append(shape("path", { class: "arrow", d: "M-5 -4.5L5 0L-5 4.5Z", transform: turn }));
        }
      }
      last = place;
    });
  }

  bar(drawing, scale, width, height) {
    const most = (0.3 * width) / scale;
    const power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((nice) => nice * power).find((metres) => metres <= most);
    const [left, right, y] = [14, 14 + length * scale, height - 12];
    drawing.append(
      shape("path", { class: "scale", d: `M${left} ${y - 5}V${y}H${right.toFixed(1)}V${y - 5}` }),
      shape("text", { class: "tick", x: left + 4, y: y - 5 }, length >= 1000 ? `${length / 1000} km` : `${length} m`),
    );
  }

  point(cursor) {
    if (!this.dot) return;
    const row = placeOf(this.signals.time, cursor - this.view.start + 1);
    const { x, y } = this.signals.columns;
    const isKnown = row >= 0 && x[row] !== null && y[row] !== null;
    this.dot.toggleAttribute("hidden", !isKnown);
    if (!isKnown) return;
    const [cx, cy] = this.place(x[row], y[row]);
    this.dot.setAttribute("cx", cx);
    this.dot.setAttribute("cy", cy);
  }
}

function extent(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return [low, high];
}
