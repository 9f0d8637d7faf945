// The two lists as the server has them, and the changes on their way to it: one after the other, each made on the
// version of its row that this page knows, sent again until it is answered. What others change arrives by asking.

const PAUSE = 1000;
const LONGEST_PAUSE = 5000;
const SILENT = "The server does not answer. Is `wheelprint review` still running?";
const LEFT_BEHIND = "This page belongs to an earlier run of `wheelprint review`; open the address that it printed last.";

export class Outbox {
  // `told` is called with what happened: "lists", "stored", "waiting", "refused", "conflict".
  constructor(told) {
    this.told = told;
    this.state = "";
    this.recordings = [];
    this.rows = { events: [], situations: [] };
    this.waiting = [];
    this.trouble = "";
    this.done = JSON.parse(sessionStorage.getItem("done") ?? "[]");
    this.undone = JSON.parse(sessionStorage.getItem("undone") ?? "[]");
    this.isSending = false;
    this.pushed = 0;
  }

  async begin() {
    await this.ask();
    this.listen();
  }

  async listen() {
    for (;;) {
      await new Promise((after) => setTimeout(after, PAUSE));
      await this.ask();
    }
  }

  // Fetch the lists if they have changed; own changes come first.
  async ask() {
    if (this.waiting.length || this.isAsking) return;
    this.isAsking = true;
    const { pushed } = this;
    try {
      const answer = await fetch(`lists?since=${this.state}`);
      if (answer.status === 200) {
        const content = await answer.json();
        // What was changed here since then may not be in these lists yet; they are asked for again.
        if (pushed !== this.pushed) return;
        this.state = content.state;
        this.recordings = content.recordings;
        for (const book of ["events", "situations"]) this.rows[book] = reconciled(this.rows[book], content[book]);
        this.settle("");
        this.told("lists");
      } else this.settle(answer.ok ? "" : answer.status === 404 ? LEFT_BEHIND : await answer.text());
    } catch {
      this.settle(SILENT);
    } finally {
      this.isAsking = false;
      if (pushed !== this.pushed) this.ask();
    }
  }

  settle(trouble) {
    this.trouble = trouble;
    this.told(trouble ? "waiting" : "stored");
  }

  set(book, row, fields, by) {
    Object.assign(row, fields);
    this.push({ book, row, by, set: fields });
  }

  add(book, addition, by) {
    this.push({ book, by, add: addition });
  }

  remove(book, row, by) {
    this.push({ book, row, by, remove: true });
  }

  undo(by) {
    this.turn(this.done, this.undone, by);
  }

  redo(by) {
    this.turn(this.undone, this.done, by);
  }

  // Taking back what took something back does it again.
  turn(from, to, by) {
    const last = from.pop();
    if (last) this.push({ book: last.book, by, undo: last.key }, to);
  }

  push(wish, stack = null) {
    wish.key = crypto.randomUUID();
    this.pushed += 1;
    if (!stack) this.undone.length = 0;
    (stack ?? this.done).push({ key: wish.key, book: wish.book });
    this.remember();
    this.waiting.push(wish);
    this.told("stored");
    this.send();
  }

  remember() {
    sessionStorage.setItem("done", JSON.stringify(this.done.slice(-500)));
    sessionStorage.setItem("undone", JSON.stringify(this.undone.slice(-500)));
  }

  async send() {
    if (this.isSending) return;
    this.isSending = true;
    let pause = PAUSE;
    while (this.waiting.length) {
      const wish = this.waiting[0];
      const { row, ...body } = wish;
      if (row) Object.assign(body, { number: row.number, version: row.version });
      let answer;
      let content;
      try {
        const headers = { "content-type": "application/json" };
        answer = await fetch("changes", { method: "POST", headers, body: JSON.stringify(body) });
        content = answer.status === 200 || answer.status === 409 ? await answer.json() : await answer.text();
      } catch {
        answer = null;
        content = SILENT;
      }
      if (answer && answer.status < 422 && answer.status !== 404) {
        this.waiting.shift();
        this.answered(wish, answer.status, content);
        this.settle("");
        pause = PAUSE;
      } else {
        this.settle(answer?.status === 404 ? LEFT_BEHIND : content);
        await new Promise((after) => setTimeout(after, pause));
        pause = Math.min(2 * pause, LONGEST_PAUSE);
      }
    }
    this.isSending = false;
    this.ask();
  }

  answered(wish, status, content) {
    if (status === 200) {
      const isLast = !this.waiting.some((other) => other.row && other.row === wish.row);
      const row = this.upsert(wish.book, content.number, content.row, isLast);
      this.told("changed", { wish, row });
      return;
    }
    this.done = this.done.filter((one) => one.key !== wish.key);
    this.undone = this.undone.filter((one) => one.key !== wish.key);
    this.remember();
    if (status !== 409) {
      this.state = "";
      this.told("refused", { text: content });
      return;
    }
    // What was changed after this one was made on the same ground; it is all one decision of the person now.
    const mine = Object.assign({}, wish.set);
    for (const other of this.waiting.filter((one) => one.row && one.row === wish.row)) Object.assign(mine, other.set);
    const dropped = new Set(this.waiting.filter((one) => one.row && one.row === wish.row).map((one) => one.key));
    this.waiting = this.waiting.filter((one) => !dropped.has(one.key));
    this.done = this.done.filter((one) => !dropped.has(one.key));
    const row = this.upsert(wish.book, content.number, content.row, true);
    this.told("conflict", { wish, mine, row });
  }

  // Put what the server says of a row in its place; null: it is gone. Later changes of it are still to come.
  upsert(book, number, content, isLast) {
    const rows = this.rows[book];
    const place = rows.findIndex((row) => row.number === number);
    if (content === null) {
      if (place >= 0) rows.splice(place, 1);
      return null;
    }
    if (place < 0) {
      const next = rows.findIndex((row) => row.recording > content.recording || (row.recording === content.recording && row.start > content.start));
      rows.splice(next < 0 ? rows.length : next, 0, content);
      return content;
    }
    return Object.assign(rows[place], isLast ? content : { number, version: content.version });
  }
}

// The new rows, as the objects that they were where they are the same rows.
function reconciled(old, rows) {
  const known = new Map(old.map((row) => [row.number, row]));
  return rows.map((row) => (known.has(row.number) ? Object.assign(known.get(row.number), row) : row));
}
