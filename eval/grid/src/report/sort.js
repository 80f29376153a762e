for (const table of document.querySelectorAll("table.sort")) {
  for (const th of table.tHead.rows[0].cells) {
    th.tabIndex = 0;
    th.title = "sort";
    th.onclick = () => {
      const down = th.ariaSort == "descending" ? 1 : -1;
      for (const other of table.tHead.rows[0].cells) other.ariaSort = null;
      th.ariaSort = down == 1 ? "ascending" : "descending";
      const key = row => { const td = row.cells[th.cellIndex]; return td.dataset.v ? Number(td.dataset.v) : td.textContent; };
      const order = (a, b) => typeof a == "number" ? a - b : a.localeCompare(b);
      const rows = [...table.tBodies[0].rows].sort((a, b) => down * order(key(a), key(b)));
      table.tBodies[0].append(...rows);
    };
    th.onkeydown = event => event.key == "Enter" ? th.onclick() : null;
  }
}
