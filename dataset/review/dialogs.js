// The questions that the page asks; each gives its answer, or null where it is left.

import { byId, clock, element } from "./elements.js";

function answered(dialog) {
  return new Promise((answer) => {
    dialog.returnValue = "";
    dialog.addEventListener("close", () => answer(dialog.returnValue), { once: true });
    dialog.showModal();
  });
}

export const isAsked = () => document.querySelector("dialog[open]") !== null;

export async function askName(suggestion) {
  const input = byId("person-name");
  input.value = suggestion;
  const asked = answered(byId("person"));
  input.select();
  return (await asked) === "ok" ? input.value.trim() || null : null;
}

export async function askNote(text) {
  const area = byId("writing-text");
  area.value = text;
  const asked = answered(byId("writing"));
  area.focus();
  area.setSelectionRange(text.length, text.length);
  return (await asked) === "ok" ? area.value : null;
}

byId("writing-text").addEventListener("keydown", (key) => {
  if (key.key === "Enter" && (key.ctrlKey || key.metaKey)) byId("writing").close("ok");
});

const LETTERS = "123456789abcdefghijklmnopqrstuvwxyz";

export async function askSituation(names, stretch) {
  byId("tagging-stretch").textContent = `From ${clock(stretch.start)} to ${clock(stretch.stop)} UTC`;
  const dialog = byId("tagging");
  byId("tags").replaceChildren(
    ...names.map((name, number) =>
      element("button", { type: "button", onclick: () => dialog.close(name) }, element("kbd", {}, LETTERS[number] ?? ""), ` ${name}`),
    ),
  );
  return (await answered(dialog)) || null;
}

byId("tagging").addEventListener("keydown", (key) => {
  const number = LETTERS.indexOf(key.key);
  if (number >= 0 && number < byId("tags").children.length) {
    key.preventDefault();
    byId("tags").children[number].click();
  }
});

// Two columns: what stands in the file now, and what this page wanted. True: take mine.
export async function askConflict(theirs, mine, row) {
  const shown = { decision: (value) => value, start: clock, stop: clock, note: (value) => value };
  const lines = Object.entries(shown).map(([field, text]) => {
    const wanted = mine[field] === undefined ? "" : text(mine[field]);
    return element("tr", {}, element("th", {}, field), element("td", {}, theirs ? text(theirs[field]) : ""), element("td", {}, wanted));
  });
  const who = theirs ? `theirs${theirs.by ? `: ${theirs.by}` : ""}` : "removed from the file";
  byId("sides").replaceChildren(element("tr", {}, element("th", {}, row?.label ?? ""), element("th", {}, who), element("th", {}, "mine")), ...lines);
  byId("conflict").querySelector("[value=mine]").hidden = !theirs;
  return (await answered(byId("conflict"))) === "mine";
}

export function showHelp(groups) {
  byId("keys").replaceChildren(
    ...groups.map(([title, keys]) =>
      element(
        "section",
        {},
        element("h3", {}, title),
        element("dl", {}, ...keys.flatMap((one) => [element("dt", {}, ...one.keys.flatMap((key, number) => [number ? " " : "", element("kbd", {}, keyName(key))])), element("dd", {}, one.does)])),
      ),
    ),
  );
  byId("help").showModal();
}

const NAMES = {
  ArrowDown: "↓", ArrowUp: "↑", ArrowLeft: "←", ArrowRight: "→", "Shift ArrowLeft": "Shift ←", "Shift ArrowRight": "Shift →",
  " ": "Space", Delete: "Del", PageUp: "Page ↑", PageDown: "Page ↓", "-": "−",
};
export const keyName = (key) => NAMES[key] ?? (key.length === 1 && key !== key.toLowerCase() ? `Shift ${key.toLowerCase()}` : key);
