// The page: what is chosen and looked at, and what each key does.

import { askConflict, askName, askNote, askSituation, isAsked, keyName, showHelp } from "./dialogs.js";
import { byId, clock, element, iso, placeOf, signed } from "./elements.js";
import { PathMap } from "./map.js";
import { Outbox } from "./outbox.js";
import { Plots, span, Timeline } from "./plots.js";

const CONTEXT = 8000; // ms shown on both sides of what is chosen
const TICK = 100;
const SECOND = 1000;
const LONGEST_VIEW = 3_600_000;
const WORDS = {
  events: { label: "Kind", done: { e: "emergency", n: "normal" } },
  situations: { label: "Situation", done: { c: "confirmed", x: "rejected" } },
};

const facts = await (await fetch("project")).json();
const outbox = new Outbox(told);
const map = new PathMap(byId("map"));
const plots = new Plots(byId("plots"), facts.panels, (time) => point(time), (edge, time) => moveEdge(edge, time));
const timeline = new Timeline(byId("timeline"), (time) => lookAt(time));
const fetched = new Map();

let book = "events";
let chosen = null;
let recording = 0;
let view = { start: 0, stop: 1 };
let cursor = 0;
let mark = null;
let content = null; // window of the view
let outline = null;
let person = facts.reviewer ?? localStorage.getItem("person") ?? "";
let isGoingOn = localStorage.getItem("going-on") !== "no";
let playing = null;

// What is listed

const rows = () => outbox.rows[book];
const driverOf = (row) => outbox.recordings[row.recording].split("/")[0];
const isOwn = (row) => row !== null && row.by === person && (row.label === "added" || row.decision === "confirmed");
const isOpen = (row) => row.decision === "proposed";

function listed() {
  const [state, label, driver] = ["by-state", "by-label", "by-driver"].map((id) => byId(id).value);
  return rows().filter(
    (row) =>
      row === chosen ||
      ((!state || (state === "open") === isOpen(row)) && (!label || row.label === label) && (!driver || driverOf(row) === driver)),
  );
}

function showList() {
  const shown = listed();
  const isFocused = byId("list").contains(document.activeElement);
  byId("list").replaceChildren(
    ...shown.map((row) => {
      const name = outbox.recordings[row.recording];
      const entry = element(
        "button",
        { type: "button", class: `entry ${row.decision}`, "aria-current": row === chosen ? "true" : null, title: name, onclick: () => choose(row) },
        element("span", { class: "entry-head" }, element("b", {}, row.label.replaceAll("_", " ")), element("span", { class: "entry-state" }, row.decision === "proposed" ? "" : row.decision)),
        element("span", { class: "entry-where" }, element("bdi", {}, name), element("span", {}, clock(row.start).slice(0, 8))),
      );
      return element("li", {}, entry);
    }),
  );
  const current = byId("list").querySelector("[aria-current]");
  current?.scrollIntoView({ block: "nearest" });
  if (isFocused) current?.focus();
  const all = rows();
  const decided = all.filter((row) => !isOpen(row)).length;
  byId("bar").max = Math.max(1, all.length);
  byId("bar").value = decided;
  byId("count").textContent = `${decided} of ${all.length} decided`;
  byId("nothing").hidden = shown.length > 0;
  byId("nothing").textContent = all.length
    ? "Nothing is left under these filters."
    : `There are no ${book} yet. \`wheelprint build\` proposes them, and you can add what it missed.`;
}

function fill(id, values, kept = byId(id).value) {
  const options = [["", "all"], ...values.map((value) => [value, value.replaceAll("_", " ")])];
  if ([...byId(id).options].map((option) => option.value).join("\n") === options.map(([value]) => value).join("\n")) return;
  byId(id).replaceChildren(...options.map(([value, text]) => element("option", { value, selected: value === kept }, text)));
}

function showFilters() {
  fill("by-label", [...new Set(rows().map((row) => row.label))].sort());
  fill("by-driver", [...new Set(rows().map(driverOf))].sort());
  byId("label-name").textContent = WORDS[book].label;
  if (byId("by-recording").options.length === outbox.recordings.length) return;
  const options = outbox.recordings.map((name, number) => element("option", { value: number, selected: number === recording }, name));
  byId("by-recording").replaceChildren(...options);
}

// What is looked at

function choose(row) {
  stop();
  chosen = row ?? null;
  mark = null;
  if (row) {
    sessionStorage.setItem("chosen", `${book} ${row.number}`);
    recording = row.recording;
    view = { start: row.start - CONTEXT, stop: row.stop + CONTEXT };
    cursor = row.start;
  }
  byId("by-recording").value = recording;
  showList();
  load();
  const after = listed()[listed().indexOf(chosen) + 1];
  if (row && after) fetchedWindow(after.recording, after.start - CONTEXT, after.stop + CONTEXT);
}

function step(by) {
  const shown = listed();
  if (shown.length) choose(shown[Math.min(Math.max(shown.indexOf(chosen) + by, 0), shown.length - 1)]);
}

function nextOpen() {
  const shown = listed();
  const place = shown.indexOf(chosen);
  choose([...shown.slice(place + 1), ...shown.slice(0, place)].find(isOpen) ?? chosen);
}

// An answer of the server, remembered for a while: going back and forth asks nothing.
function kept(address) {
  if (!fetched.has(address)) {
    fetched.set(
      address,
      fetch(address).then(async (answer) => {
        if (!answer.ok) throw new Error(await answer.text());
        return answer.json();
      }),
    );
    fetched.get(address).catch(() => fetched.delete(address));
    if (fetched.size > 60) fetched.delete(fetched.keys().next().value);
  }
  return fetched.get(address);
}

const fetchedWindow = (number, start, stop) => kept(`recordings/${number}/window?start=${Math.max(0, start)}&stop=${stop}`);

let loads = 0;
async function load() {
  loads += 1;
  const load = loads;
  show();
  try {
    const [whole, inside] = await Promise.all([kept(`recordings/${recording}/outline`), fetchedWindow(recording, view.start, view.stop)]);
    if (load !== loads) return;
    outline = whole;
    content = { ...inside, view: { ...view }, recording };
    alertOf("window", inside.problem);
  } catch (error) {
    if (load !== loads) return;
    content = null;
    alertOf("window", error.message);
  }
  show();
}

function show() {
  showHead();
  const isThere = content && content.recording === recording && content.view.start === view.start && content.view.stop === view.stop;
  if (!isThere) return;
  const inside = (row) => row.recording === recording && row.stop > view.start && row.start < view.stop;
  const lanes = Object.entries(outbox.rows).map(([name, all]) => ({ name: name === "events" ? "events" : "situation", rows: all.filter(inside) }));
  plots.draw({ view, signals: content.signals, lanes, chosen, cursor, mark });
  map.draw(view, content.signals, outline, chosen, cursor);
  timeline.draw(outline, rows().filter((row) => row.recording === recording), view, chosen);
  showCameras();
  point(cursor);
}

function showHead() {
  const name = outbox.recordings[recording] ?? "";
  byId("head").className = chosen?.decision ?? "";
  byId("label").textContent = chosen ? chosen.label.replaceAll("_", " ") : "Looking around";
  byId("decision").textContent = chosen ? (isOpen(chosen) ? "undecided" : chosen.decision) : "";
  byId("severity").textContent = chosen?.severity ? `severity ${chosen.severity.toFixed(2)} × threshold` : "";
  byId("recording").textContent = name;
  byId("recording").title = name;
  const who = chosen?.by ? ` · ${chosen.decision} by ${chosen.by}${chosen.at ? `, ${chosen.at.slice(0, 16).replace("T", " ")} UTC` : ""}` : "";
  const from = chosen ?? view;
  byId("when").textContent = ` · ${iso(from.start).slice(0, 10)} ${clock(from.start)} UTC · ${span(from)}${who}`;
  byId("note").textContent = chosen?.note ?? "";
  for (const button of document.querySelectorAll("#actions button")) {
    button.setAttribute("aria-pressed", chosen !== null && button.dataset.decision === chosen.decision);
    button.disabled = !chosen;
    if (button.dataset.removes) button.hidden = !isOwn(chosen);
  }
}

function point(time) {
  cursor = Math.min(Math.max(time, view.start), view.stop);
  plots.point(cursor);
  map.point(cursor);
  byId("cursor").textContent = `Cursor ${clock(cursor)}${chosen ? `, ${signed(cursor - chosen.start)}` : ""}${mark === null ? "" : `; mark ${clock(mark)}`}`;
  for (const camera of byId("cameras").children) frameAt(camera, cursor);
}

function showCameras() {
  const cameras = content.cameras.map((camera, number) => ({ ...camera, at: number })).filter((camera) => camera.times.length);
  byId("cameras").replaceChildren(
    ...cameras.map((camera) => {
      const middle = chosen ?? view;
      const picks = [...new Set([0, 1, 2, 3, 4].map((part) => nearest(camera.times, middle.start + (part / 4) * (middle.stop - middle.start))))];
      const strip = picks.map((row) =>
        element("img", { src: frameAddress(camera, row), alt: `${camera.name} at ${clock(camera.times[row])}`, title: clock(camera.times[row]), onclick: () => point(camera.times[row]) }),
      );
      const figure = element("figure", {}, element("img", { class: "frame", alt: "" }), element("figcaption", {}), element("div", { class: "strip" }, ...strip));
      figure.camera = camera;
      return figure;
    }),
  );
}

const frameAddress = (camera, row) => `recordings/${content.recording}/frames/${camera.at}/${camera.numbers[row]}`;

function nearest(times, time) {
  const row = placeOf(times, time);
  if (row < 0) return 0;
  return row + 1 < times.length && times[row + 1] - time < time - times[row] ? row + 1 : row;
}

function frameAt(figure, time) {
  const { camera } = figure;
  const row = nearest(camera.times, time);
  const image = figure.querySelector(".frame");
  if (image.getAttribute("src") !== frameAddress(camera, row)) image.setAttribute("src", frameAddress(camera, row));
  image.alt = `${camera.name} at ${clock(camera.times[row])} UTC`;
  figure.querySelector("figcaption").textContent = `${camera.name} · ${signed(camera.times[row] - time)} from the cursor`;
}

function setView(start, stop) {
  const middle = (start + stop) / 2;
  const length = Math.min(Math.max(stop - start, 2000), LONGEST_VIEW);
  view = { start: Math.max(0, Math.round(middle - length / 2)), stop: Math.round(middle + length / 2) };
  cursor = Math.min(Math.max(cursor, view.start), view.stop);
  load();
}

const zoom = (factor) => setView(cursor - (cursor - view.start) * factor, cursor + (view.stop - cursor) * factor);

function pan(share) {
  const by = Math.round(share * (view.stop - view.start));
  cursor += by;
  setView(view.start + by, view.stop + by);
}

function lookAt(time) {
  const half = Math.round((view.stop - view.start) / 2);
  cursor = time;
  setView(time - half, time + half);
}

function moveCursor(by) {
  if (cursor + by < view.start || cursor + by > view.stop) pan(Math.sign(by) * 0.5);
  point(Math.round((cursor + by) / TICK) * TICK);
}

function play() {
  if (playing) return stop();
  let before = performance.now();
  const tick = (now) => {
    point(cursor + now - before);
    before = now;
    if (cursor >= view.stop) stop();
    else playing = requestAnimationFrame(tick);
  };
  if (cursor >= view.stop) point(view.start);
  playing = requestAnimationFrame(tick);
}

function stop() {
  if (playing) cancelAnimationFrame(playing);
  playing = null;
}

async function browse(number) {
  stop();
  chosen = null;
  mark = null;
  recording = number;
  const whole = await kept(`recordings/${number}/outline`).catch(() => null);
  showList();
  if (whole?.start) {
    cursor = whole.start;
    setView(whole.start, Math.min(whole.stop, whole.start + 60_000));
  } else load();
}

// What is changed

// One question at a time: a key pressed between the closing of the dialog and its answer waits for the answer.
let naming = null;

function named() {
  naming ??= askWho().finally(() => (naming = null));
  return naming;
}

async function askWho() {
  while (!person) {
    person = (await askName(facts.user)) ?? "";
    if (!person) return false;
  }
  localStorage.setItem("person", person);
  showPerson();
  return true;
}

async function decide(decision) {
  if (!chosen || !(await named())) return;
  const isFirst = isOpen(chosen);
  outbox.set(book, chosen, { decision }, person);
  Object.assign(chosen, decision === "proposed" ? { by: "", at: "" } : { by: person, at: iso(Date.now()) });
  if (isGoingOn && isFirst && decision !== "proposed") nextOpen();
  else {
    showList();
    show();
  }
}

async function moveEdge(edge, time) {
  if (!chosen) return;
  const other = edge === "start" ? chosen.stop - TICK : chosen.start + TICK;
  const to = edge === "start" ? Math.min(time, other) : Math.max(time, other);
  if (to === chosen[edge] || !(await named())) return show();
  outbox.set(book, chosen, { [edge]: to }, person);
  point(to);
  if (to < view.start || to > view.stop) setView(Math.min(view.start, to - CONTEXT), Math.max(view.stop, to + CONTEXT));
  else show();
  if (isOpen(chosen)) say("The edge is stored. Decide about the event to keep it: the next build proposes undecided ones again.");
}

// From the mark to the cursor; without a mark what is chosen, or a second on both sides of the cursor.
function stretch(isAroundChosen) {
  if (mark !== null && mark !== cursor) return { start: Math.min(mark, cursor), stop: Math.max(mark, cursor) };
  if (isAroundChosen && chosen) return { start: chosen.start, stop: chosen.stop };
  return { start: cursor - SECOND, stop: cursor + SECOND };
}

const rounded = ({ start, stop: end }) => ({ start: Math.round(start / TICK) * TICK, stop: Math.round(end / TICK) * TICK });

async function addMissed() {
  if (!(await named())) return;
  if (book !== "events") turnTo("events");
  outbox.add("events", { recording, ...rounded(stretch(false)), label: "added" }, person);
}

async function tag() {
  const wanted = rounded(stretch(true));
  if (!(await named())) return;
  const label = await askSituation(facts.situations, wanted);
  if (label) outbox.add("situations", { recording, ...wanted, label }, person);
}

function remove() {
  if (chosen && person) outbox.remove(book, chosen, person);
}

async function writeNote() {
  if (!chosen || !(await named())) return;
  const row = chosen;
  const text = await askNote(row.note);
  if (text === null || text === row.note) return;
  outbox.set(book, row, { note: text }, person);
  show();
}

function turnTo(name) {
  book = name;
  for (const button of document.querySelectorAll("#books button")) button.setAttribute("aria-pressed", button.dataset.book === book);
  for (const id of ["by-label", "by-driver"]) byId(id).value = "";
  document.querySelector("nav").setAttribute("aria-label", `${name} and filters`);
  byId("list").setAttribute("aria-label", name);
  showActions();
  showFilters();
  chosen = null;
  const near = rows().find((row) => row.recording === recording && row.stop > cursor) ?? rows()[0];
  if (near) choose(near);
  else {
    showList();
    show();
  }
}

// What is told

function told(what, about) {
  if (what === "lists") {
    if (chosen && !rows().includes(chosen)) chosen = null;
    showFilters();
    if (chosen || !rows().length) showList();
    else step(1);
    show();
  } else if (what === "changed") changed(about);
  else if (what === "refused") say(about.text, true);
  else if (what === "conflict") conflict(about);
  showStored();
}

function changed({ wish, row }) {
  const isAddition = wish.add || (wish.undo && row && !listed().includes(row));
  if (wish.book === book && row && (wish.undo || isAddition)) choose(row);
  else if (chosen && !rows().includes(chosen)) {
    chosen = null;
    step(1);
  } else {
    if (wish.add) say(`Tagged as ${wish.add.label}.`);
    showList();
    show();
  }
  if (wish.remove || (wish.undo && !row)) say("Removed.");
}

async function conflict({ wish, mine, row }) {
  showList();
  show();
  if (wish.undo) say(`This cannot be taken back: ${row ? `it has been changed since${row.by ? ` by ${row.by}` : ""}` : "it is gone from the file"}.`, true);
  else if (await askConflict(row, mine, row ?? wish.row)) outbox.set(wish.book, row, mine, person);
  showList();
  show();
}

function showStored() {
  const waiting = outbox.waiting.length;
  const stored = byId("stored");
  stored.className = outbox.trouble ? "trouble" : "";
  stored.textContent = waiting ? `${waiting} ${waiting === 1 ? "change" : "changes"} not stored yet` : outbox.trouble ? "No contact" : "All stored";
  alertOf("contact", outbox.trouble ? `${waiting ? `${waiting === 1 ? "1 change is" : `${waiting} changes are`} not stored, and sent again until ${waiting === 1 ? "it is" : "they are"}. ` : ""}${outbox.trouble}` : "");
  byId("undo").disabled = !outbox.done.length;
  byId("redo").disabled = !outbox.undone.length;
}

function alertOf(name, text) {
  let line = document.querySelector(`#alerts [data-name="${name}"]`);
  if (!text) return line?.remove();
  if (!line) {
    line = element("p", { "data-name": name });
    byId("alerts").append(line);
  }
  if (line.textContent !== text) line.textContent = text;
}

let saying = null;
function say(text, isAlert = false) {
  clearTimeout(saying);
  alertOf("refused", isAlert ? text : "");
  alertOf("said", isAlert ? "" : text);
  document.querySelector('#alerts [data-name="said"]')?.classList.add("said");
  saying = setTimeout(() => ["refused", "said"].forEach((name) => alertOf(name, "")), isAlert ? 12_000 : 5000);
}

function showPerson() {
  byId("who").replaceChildren(element("bdi", {}, person || "Who are you?"));
}

// Keys and the buttons for the same

const edgeKeys = (keys, edge, by) => ({ keys, does: `${edge} ${by < 0 ? "earlier" : "later"}, ${Math.abs(by) / 1000} s`, run: () => moveEdge(edge, (chosen?.[edge] ?? 0) + by), again: true });
const decisions = (name) => Object.entries(WORDS[name].done).map(([key, decision]) => ({ keys: [key], does: decision, book: name, run: () => decide(decision) }));

const KEYS = [
  ["Choose", [
    { keys: ["j", "ArrowDown"], does: "next", run: () => step(1), again: true },
    { keys: ["k", "ArrowUp"], does: "previous", run: () => step(-1), again: true },
    { keys: ["l"], does: "next undecided", run: nextOpen },
    { keys: ["v"], does: "events or situations", run: () => turnTo(book === "events" ? "situations" : "events") },
    { keys: ["/"], does: "to the filters", run: () => byId("by-state").focus() },
    { keys: ["r"], does: "to the recordings", run: () => byId("by-recording").focus() },
  ]],
  ["Decide", [
    ...decisions("events"),
    ...decisions("situations"),
    { keys: ["u"], does: "undecided again", run: () => decide("proposed") },
    { keys: ["w"], does: "write a note", run: writeNote },
    { keys: ["z"], does: "undo", run: () => outbox.undo(person), again: true },
    { keys: ["Z", "y"], does: "redo", run: () => outbox.redo(person), again: true },
    { keys: ["g"], does: "go on to the next after deciding, or stay", run: goOn },
    { keys: ["p"], does: "another person decides", run: rename },
  ]],
  ["Move the edges", [
    edgeKeys(["a"], "start", -TICK), edgeKeys(["s"], "start", TICK), edgeKeys(["A"], "start", -SECOND), edgeKeys(["S"], "start", SECOND),
    edgeKeys(["d"], "stop", -TICK), edgeKeys(["f"], "stop", TICK), edgeKeys(["D"], "stop", -SECOND), edgeKeys(["F"], "stop", SECOND),
    { keys: ["i"], does: "start at the cursor", run: () => moveEdge("start", Math.round(cursor / TICK) * TICK) },
    { keys: ["o"], does: "stop at the cursor", run: () => moveEdge("stop", Math.round(cursor / TICK) * TICK) },
  ]],
  ["Look around", [
    { keys: ["ArrowLeft"], does: "cursor back, 0.1 s", run: () => moveCursor(-TICK), again: true },
    { keys: ["ArrowRight"], does: "cursor on, 0.1 s", run: () => moveCursor(TICK), again: true },
    { keys: ["Shift ArrowLeft"], does: "cursor back, 1 s", run: () => moveCursor(-SECOND), again: true },
    { keys: ["Shift ArrowRight"], does: "cursor on, 1 s", run: () => moveCursor(SECOND), again: true },
    { keys: [" "], does: "play or stop", run: play },
    { keys: ["+", "="], does: "closer", run: () => zoom(1 / 1.5), again: true },
    { keys: ["-"], does: "wider", run: () => zoom(1.5), again: true },
    { keys: ["PageUp"], does: "earlier in the recording", run: () => pan(-0.5), again: true },
    { keys: ["PageDown"], does: "later in the recording", run: () => pan(0.5), again: true },
    { keys: ["0"], does: "back to what is chosen", run: () => choose(chosen) },
  ]],
  ["Add", [
    { keys: ["b"], does: "mark the cursor; a stretch goes from here to the cursor", run: () => { mark = mark === cursor ? null : cursor; show(); } },
    { keys: ["m"], does: "add a missed event at the cursor", run: addMissed },
    { keys: ["t"], does: "tag a situation: mark to cursor, or what is chosen", run: tag },
    { keys: ["Delete", "Backspace"], does: "remove what you added", run: remove },
    { keys: ["?"], does: "this list", run: () => showHelp(KEYS) },
  ]],
];

const ALL = KEYS.flatMap(([, keys]) => keys);

function goOn() {
  isGoingOn = !isGoingOn;
  localStorage.setItem("going-on", isGoingOn ? "yes" : "no");
  say(isGoingOn ? "After deciding, the next undecided one is shown." : "After deciding, the page stays where it is.");
}

async function rename() {
  person = (await askName(person || facts.user)) ?? person;
  if (person) localStorage.setItem("person", person);
  showPerson();
}

document.addEventListener("keydown", (key) => {
  if (isAsked()) return;
  // The field of a question that was just closed has the focus until the page is drawn again.
  const isField = key.target.matches("select, input, textarea") && !key.target.closest("dialog");
  if (key.key === "Escape") {
    if (isField) key.target.blur();
    return alertOf("refused", "");
  }
  if ((key.ctrlKey || key.metaKey) && ["z", "Z", "y"].includes(key.key)) {
    key.preventDefault();
    return key.key === "z" && !key.shiftKey ? outbox.undo(person) : outbox.redo(person);
  }
  if (isField || key.ctrlKey || key.metaKey || key.altKey) return;
  if (key.key === " " && key.target.matches("button")) return;
  const name = key.shiftKey && key.key.startsWith("Arrow") ? `Shift ${key.key}` : key.key;
  const found = ALL.find((one) => one.keys.includes(name) && (!one.book || one.book === book));
  if (!found || (key.repeat && !found.again)) return;
  key.preventDefault();
  found.run();
});

function button(does, text, more = {}) {
  const one = ALL.find((other) => other.does === does);
  return element("button", { type: "button", title: one.does, onclick: one.run, ...more }, text, " ", element("kbd", {}, keyName(one.keys[0])));
}

const capital = (text) => text[0].toUpperCase() + text.slice(1);

function showActions() {
  const words = Object.values(WORDS[book].done).map((word) => button(word, capital(word), { "data-decision": word, class: `decide ${word}` }));
  byId("actions").replaceChildren(...words, button("undecided again", "Undecided", { "data-decision": "proposed" }), button("write a note", "Note"), button("tag a situation: mark to cursor, or what is chosen", "Situation"), button("remove what you added", "Remove", { "data-removes": "yes" }));
}

byId("tools").append(
  button("undo", "Undo", { id: "undo" }),
  button("redo", "Redo", { id: "redo" }),
  element("button", { type: "button", id: "who", title: "who decides", onclick: rename }),
  element("button", { type: "button", id: "help-button", onclick: () => showHelp(KEYS) }, "Keys ", element("kbd", {}, "?")),
);
byId("moves").append(
  element("span", {}, "Start"), ...["a", "s"].map((key) => edgeButton(key)),
  element("span", {}, "Stop"), ...["d", "f"].map((key) => edgeButton(key)),
  button("add a missed event at the cursor", "Add event"), button("play or stop", "Play"), button("closer", "+"), button("wider", "−"),
);

function edgeButton(key) {
  const [small, large] = [key, key.toUpperCase()].map((name) => ALL.find((one) => one.keys[0] === name));
  const way = "as"[0] === key || "df"[0] === key ? "−" : "+";
  return element("button", { type: "button", title: `${small.does}; with Shift 1 s`, onclick: (event) => (event.shiftKey ? large : small).run() }, `${way}0.1 s `, element("kbd", {}, key));
}

for (const id of ["by-state", "by-label", "by-driver"]) byId(id).addEventListener("change", () => showList());
byId("by-recording").addEventListener("change", (event) => browse(Number(event.target.value)));
for (const one of document.querySelectorAll("#books button")) one.addEventListener("click", () => turnTo(one.dataset.book));
new ResizeObserver(() => show()).observe(byId("plots"));
document.addEventListener("visibilitychange", () => document.hidden || outbox.ask());
addEventListener("beforeunload", (event) => outbox.waiting.length && event.preventDefault());

// Where it begins: what was chosen before a reload, else the first undecided one.

byId("project").textContent = facts.name;
document.title = `Review of ${facts.name}`;
showActions();
showPerson();
const [before, number] = (sessionStorage.getItem("chosen") ?? " ").split(" ");
if (before === "situations") book = before;
await outbox.begin();
if (before === "situations") turnTo(before);
const first = rows().find((row) => row.number === Number(number)) ?? rows().find(isOpen) ?? rows()[0];
if (first) choose(first);
else browse(0);
document.body.dataset.ready = "yes";
if (!person) named();
