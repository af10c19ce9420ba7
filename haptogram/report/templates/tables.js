// Tables that sort by a column and are searched by words; without this script they are as they are.

const LEAST_SORTED = 3; // rows
const LEAST_SEARCHED = 12;
const NOTHING = ["", "–"]; // comes last in either order
const WORDS = new Intl.Collator("en", { numeric: true });

function textOf(cell) {
  return cell?.textContent.trim().replace("−", "-") ?? "";
}

function comparedBy(column, rows) {
  const numbers = rows.every((row) => NOTHING.includes(textOf(row.cells[column])) ||
    Number.isFinite(Number.parseFloat(textOf(row.cells[column]))));
  return (one, other) => (numbers ? Number.parseFloat(one) - Number.parseFloat(other) : WORDS.compare(one, other));
}

function sortRows(body, rows, column, direction) {
  const compare = comparedBy(column, rows);
  const isEmpty = (row) => NOTHING.includes(textOf(row.cells[column]));
  const filled = rows.filter((row) => !isEmpty(row));
  const ordered = filled.sort((one, other) => direction * compare(textOf(one.cells[column]), textOf(other.cells[column])));
  body.append(...(direction ? [...ordered, ...rows.filter(isEmpty)] : rows));
}

// A press on the name of a column sorts up, the next one down, the third restores the order.
function addSorting(table, rows) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    if (!head.textContent.trim()) return;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    button.addEventListener("click", () => {
      const next = { ascending: "descending", descending: "none" }[head.ariaSort] ?? "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      if (next !== "none") head.ariaSort = next;
      sortRows(table.tBodies[0], rows, column, { ascending: 1, descending: -1, none: 0 }[next]);
    });
    head.append(button);
  });
}

function wordsOf(row) {
  const copy = row.cloneNode(true);
  for (const bytes of copy.querySelectorAll("pre")) bytes.remove();
  return copy.textContent.toLowerCase();
}

// One field for all tables with the same columns, as those of the chapters; folds without a row vanish.
function addSearch(tables) {
  const foldOf = (table) => (tables.length > 1 ? table.closest("details:not(.part)") : null);
  const rows = tables.flatMap((table) => [...table.tBodies[0].rows]);
  const label = document.createElement("label");
  const input = document.createElement("input");
  const count = document.createElement("output");
  label.className = "search";
  input.type = "search";
  label.append("Rows with ", input, " ", count);
  const texts = rows.map(wordsOf);
  const show = () => {
    const words = input.value.toLowerCase().split(/\s+/);
    rows.forEach((row, at) => { row.hidden = !words.every((word) => texts[at].includes(word)); });
    for (const table of tables) {
      const found = [...table.tBodies[0].rows].some((row) => !row.hidden);
      const fold = foldOf(table);
      (fold ?? table.parentElement).hidden = !found;
      if (fold && input.value.trim()) fold.open = found;
    }
    count.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length}`;
  };
  input.addEventListener("input", show);
  show();
  (foldOf(tables[0]) ?? tables[0].parentElement).before(label);
}

// What an address points at is shown, though it be folded or filtered away.
function reveal() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let part = target; part; part = part.parentElement) {
    if (part.tagName === "DETAILS") part.open = true;
    part.hidden &&= false;
  }
  target?.scrollIntoView();
}

const alike = new Map(); // the tables, by the names of their columns
for (const table of document.querySelectorAll("table:not(.fixed)")) {
  if (!table.tHead || !table.tBodies[0]) continue;
  const columns = table.tHead.textContent;
  alike.set(columns, [...(alike.get(columns) ?? []), table]);
  const rows = [...table.tBodies[0].rows];
  if (rows.length >= LEAST_SORTED) addSorting(table, rows);
}
for (const tables of alike.values()) {
  if (tables.reduce((sum, table) => sum + table.tBodies[0].rows.length, 0) >= LEAST_SEARCHED) addSearch(tables);
}
addEventListener("hashchange", reveal);
if (location.hash) reveal();
