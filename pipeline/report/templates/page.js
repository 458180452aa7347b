"use strict";
// A header sorts its table: the largest number or first word first, then the other way round, then as it was.
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0], given = [...body.rows], heads = [...table.tHead.rows[0].cells];
  const words = new Intl.Collator("en", { numeric: true });
  heads.forEach((head, column) => head.firstElementChild.addEventListener("click", () => {
    const isWord = head.classList.contains("words");
    const [first, second] = isWord ? ["ascending", "descending"] : ["descending", "ascending"];
    const now = head.getAttribute("aria-sort"), next = now === first ? second : now === second ? null : first;
    for (const other of heads) other.removeAttribute("aria-sort");
    if (next) head.setAttribute("aria-sort", next);
    const sign = next === "ascending" ? 1 : -1;
    const compare = (a, b) => {
      const [one, two] = [a, b].map((row) => row.cells[column]);
      if (isWord) return sign * words.compare(one.textContent, two.textContent);
      const [left, right] = [one, two].map((cell) => parseFloat(cell.dataset.key));
      if (isNaN(left) || isNaN(right)) return isNaN(left) - isNaN(right); // what is missing comes last either way
      return sign * (left - right);
    };
    body.append(...(next ? [...given].sort(compare) : given));
  }));
}
// One study is shown at a time: a link above, or to anything within a study, chooses it and opens the folds around the target.
const articles = [...document.querySelectorAll("main > article")], links = [...document.querySelectorAll("nav a")];
const show = (article) => {
  if (!article || !article.hidden && articles.some((one) => one.hidden)) return;
  for (const one of articles) one.hidden = one !== article;
  for (const link of links) link.toggleAttribute("aria-current", link.hash === `#${article.id}`);
  dispatchEvent(new CustomEvent("study", { detail: article }));
};
const reveal = () => {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  show(target && target.closest("article") || articles.find((one) => !one.hidden));
  for (let fold = target && target.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
  if (target) target.scrollIntoView();
};
addEventListener("hashchange", reveal);
addEventListener("DOMContentLoaded", reveal);
// A click on a number or a dot shows its model and day on the map.
addEventListener("click", ({ target }) => {
  const of = target.closest("[data-day]");
  if (of) dispatchEvent(new CustomEvent("open", { detail: of.dataset }));
});
