// Links and addresses open the section they lead to; tables of class "sortable" sort by column and filter by words.
const reveal = () => {
  const target = location.hash && document.getElementById(location.hash.slice(1));
  for (let at = target; at; at = at.parentElement) if (at.tagName === "DETAILS") at.open = true;
  if (target) target.scrollIntoView();
};
addEventListener("hashchange", reveal);
addEventListener("DOMContentLoaded", reveal);
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  let last = -1, way = 1;
  [...table.tHead.rows[0].cells].forEach((head, i) => head.addEventListener("click", () => {
    way = last === i ? -way : (head.classList.contains("n") ? -1 : 1); last = i;
    const value = row => { const c = row.cells[i]; return c ? (c.dataset.v ?? c.textContent.trim()) : ""; };
    [...body.rows].sort((a, b) => {
      const x = value(a), y = value(b), p = parseFloat(x), q = parseFloat(y);
      return way * (isNaN(p) || isNaN(q) ? x.localeCompare(y) : p - q);
    }).forEach(row => body.append(row));
  }));
  const filter = document.querySelector(`input[data-filter="${table.id}"]`);
  if (filter) filter.addEventListener("input", e => {
    const words = e.target.value.toLowerCase().split(/\s+/);
    for (const row of body.rows) row.hidden = !words.every(w => row.textContent.toLowerCase().includes(w));
  });
}
