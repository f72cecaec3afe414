// The overview sorts by any column: by the buttons in its head, or on a phone by a list.
"use strict";

silmesh.sortOverview = function (table, select) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells];
  const inOrder = [...body.rows];

  function sort(column, descending) {
    const key = (row) => row.cells[column].dataset.value;
    const numbers = inOrder.every((row) => key(row) === "" || !isNaN(key(row)));
    const compare = numbers ? (a, b) => a - b : (a, b) => a.localeCompare(b);
    const rows = [...inOrder].sort((a, b) => {
      const [x, y] = [key(a), key(b)];
      if (x === "" || y === "") return (x === "") - (y === ""); // what lacks comes last
      return (descending ? -1 : 1) * compare(x, y);
    });
    body.append(...rows);
    heads.forEach((head, i) => {
      if (i === column) head.setAttribute("aria-sort", descending ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    });
  }

  heads.forEach((head, column) => {
    const button = head.querySelector("button");
    button?.addEventListener("click", () =>
      sort(column, head.getAttribute("aria-sort") === "ascending"));
  });
  select.addEventListener("change", () => {
    const [column, way] = select.value.split(" ");
    if (column) sort(Number(column), way === "descending");
    else body.append(...inOrder);
  });
};
