"use strict";
(async () => {
  const content = (id) => document.getElementById(id)?.textContent;
  const say = (words) => {
    const line = document.createElement("p");
    line.className = "warning";
    line.textContent = words;
    document.querySelector("main").before(line);
  };

  // Tables that are sorted by a click on a heading and show the rows that have the words of a field.
  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0];
    const number = (cell) => parseFloat(cell.textContent.replaceAll(",", ""));
    const order = (a, b) => {
      const [x, y] = [number(a), number(b)];
      if (a.classList.contains("number")) return Number.isNaN(x) - Number.isNaN(y) || x - y;
      return a.textContent.localeCompare(b.textContent);
    };
    for (const heading of table.querySelectorAll("th")) {
      heading.tabIndex = 0;
      const sort = () => {
        // First the largest number, or the first word; another click turns it round.
        const before = heading.getAttribute("aria-sort");
        const up = before ? before === "descending" : !body.rows[0]?.cells[heading.cellIndex].classList.contains("number");
        table.querySelectorAll("th").forEach((other) => other.removeAttribute("aria-sort"));
        heading.setAttribute("aria-sort", up ? "ascending" : "descending");
        const i = heading.cellIndex;
        const rows = [...body.rows].sort((a, b) => order(a.cells[i], b.cells[i]) * (up ? 1 : -1));
        body.append(...rows);
      };
      heading.addEventListener("click", sort);
      heading.addEventListener("keydown", (event) => event.key === "Enter" && sort());
    }
    const field = document.createElement("input");
    field.type = "search";
    field.className = "filter";
    field.placeholder = "show rows with ...";
    field.setAttribute("aria-label", "show rows with these words");
    field.addEventListener("input", () => {
      const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
      for (const row of body.rows) {
        const text = row.textContent.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
      }
    });
    table.before(field);
  }

  // The player is a document of its own, in a frame without our origin: its scripts cannot reach this page.
  const place = document.getElementById("playback-place");
  document.getElementById("playback-start")?.addEventListener("click", () => {
    const frame = document.createElement("iframe");
    frame.title = "3D playback";
    frame.setAttribute("sandbox", "allow-scripts");
    frame.srcdoc = JSON.parse(content("player"));
    place.replaceChildren(frame);
  });

  if (!("DecompressionStream" in window)) {
    say("The charts need Chrome or Edge 80, Firefox 113, Safari 16.4 or newer. The tables are complete.");
    return;
  }
  const packed = Uint8Array.from(atob(content("plotly")), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const library = document.createElement("script");
  library.textContent = await new Response(stream).text();
  document.head.append(library);

  const options = {
    displaylogo: false,
    modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    toImageButtonOptions: { format: "svg" },
  };
  // A chart is as wide as its place, whatever made that wider or narrower: the window, a scroll bar, the end of a print.
  const drawn = new Map(); // chart → its place's width, px
  const places = new ResizeObserver((changed) => {
    for (const { target, contentRect } of changed) {
      if (contentRect.width && contentRect.width !== drawn.get(target)) Plotly.Plots.resize(target);
      drawn.set(target, contentRect.width);
    }
  });
  // What is folded away has no width to be drawn in: its charts are drawn when it is opened, or printed.
  const waiting = new Map(); // chart → figure
  const draw = async (chart) => {
    const figure = waiting.get(chart);
    if (!figure || !waiting.delete(chart)) return;
    drawn.set(chart, chart.getBoundingClientRect().width);
    await Plotly.newPlot(chart, figure.data, figure.layout, options);
    places.observe(chart);
  };
  const isFolded = (chart) => chart.closest("details:not([open])");
  for (const part of document.querySelectorAll("details")) {
    part.addEventListener("toggle", () => part.querySelectorAll(".chart").forEach((one) => isFolded(one) || draw(one)));
  }
  const unfold = () => document.getElementById(location.hash.slice(1))?.querySelector(":scope > details")?.setAttribute("open", "");
  addEventListener("hashchange", unfold);
  unfold();
  for (const [i, figure] of JSON.parse(content("figures")).entries()) {
    const chart = document.getElementById(`chart${i + 1}`);
    waiting.set(chart, figure);
    if (isFolded(chart)) continue;
    await draw(chart);
    await new Promise((resume) => setTimeout(resume));
  }

  // Paper is as wide as A4 between its margins, whatever the window is.
  const PAPER = 680;
  addEventListener("beforeprint", () => {
    document.querySelectorAll("section.folded > details").forEach((one) => one.setAttribute("open", ""));
    [...waiting.keys()].forEach(draw);
    for (const chart of drawn.keys()) {
      const scale = chart.classList.contains("square") ? 0.9 : 0.8;
      Plotly.relayout(chart, {
        width: Math.min(PAPER, chart.clientWidth),
        height: Math.round(scale * chart.clientHeight),
        autosize: false,
      });
    }
  });
  addEventListener("afterprint", () => {
    for (const chart of drawn.keys()) Plotly.relayout(chart, { width: null, height: null, autosize: true });
  });
  document.documentElement.dataset.ready = "yes";
})();
