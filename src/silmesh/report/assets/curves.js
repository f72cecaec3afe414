// Curves by uPlot: losses against the iteration, and the IoU of each view.
"use strict";

silmesh.DASHES = [[], [6, 3], [8, 3, 2, 3]];

silmesh.style = (place) => ({
  stroke: silmesh.colour(`--v${place % 7}`),
  dash: silmesh.DASHES[Math.floor(place / 7) % 3],
  width: 2,
});

// A chart that fills its box, follows its width and the theme, and whose cursor the arrows move.
silmesh.chart = function (box, describe) {
  let plot = null;
  function draw() {
    plot?.destroy();
    const { data, options } = describe();
    const size = { width: box.clientWidth, height: box.clientWidth < 500 ? 260 : 340 };
    const axis = {
      stroke: silmesh.colour("--ink"),
      grid: { stroke: silmesh.colour("--line"), width: 1 },
      ticks: { stroke: silmesh.colour("--line"), width: 1 },
    };
    options.axes = options.axes.map((given) => ({ ...axis, ...given }));
    plot = new uPlot({ ...size, cursor: { y: false }, ...options }, data, box);
  }
  draw();
  new ResizeObserver(() => {
    if (plot.width !== box.clientWidth && box.clientWidth)
      plot.setSize({ width: box.clientWidth, height: plot.height });
  }).observe(box);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  box.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const last = plot.data[0].length - 1;
    const at = Math.min(Math.max((plot.cursor.idx ?? -1) + step, 0), last);
    plot.setCursor({ left: plot.valToPos(plot.data[0][at], "x"), top: 10 });
  });
  return draw;
};

silmesh.drawLosses = function (box, runs, places, switches) {
  function describe() {
    const [logX, logY] = switches.map((input) => input.checked);
    const tables = [];
    const series = [{ label: "iteration", value: (_, x) => (x == null ? "–" : x - logX) }];
    const value = (_, y) => (y == null ? "–" : y.toFixed(4));
    runs.forEach((run, i) => {
      const style = silmesh.style(places[i]);
      const along = (curve) => curve.iteration.map((x) => x + logX); // a logarithm has no 0
      tables.push([along(run.curve), run.curve.loss]);
      series.push({ label: run.variant, ...style, value, spanGaps: true, points: { show: false } });
      if (!run.published) return;
      tables.push([along(run.published), run.published.loss]);
      const points = { show: true, size: 6, fill: silmesh.colour("--ground"), stroke: style.stroke };
      const label = `${run.variant}, published`;
      series.push({ label, stroke: style.stroke, width: 1, dash: [2, 4], value, spanGaps: true, points });
    });
    const last = Math.max(...runs.map((run) => run.curve.iteration.at(-1)));
    const scales = {
      x: { time: false, distr: logX ? 3 : 1, range: [Number(logX), Math.max(last + logX, 1)] },
      y: logY ? { distr: 3 } : { range: (_, low, high) => [0, 1.05 * high] },
    };
    const axes = [
      { label: logX ? "iteration + 1" : "iteration" },
      { label: "loss", size: 60, values: logY ? (_, ticks) => ticks.map((t) => t && String(t)) : undefined },
    ];
    return { data: uPlot.join(tables), options: { series, scales, axes } };
  }
  const draw = silmesh.chart(box, describe);
  switches.forEach((input) => input.addEventListener("change", draw));
};

silmesh.drawViews = function (box, runs, places) {
  const names = [...new Set(runs.flatMap((run) => Object.keys(run.iou)))];
  function describe() {
    const data = [names.map((_, i) => i + 1), ...runs.map((run) => names.map((n) => run.iou[n]))];
    const value = (_, y) => (y == null ? "–" : y.toFixed(3));
    const series = [
      { label: "view", value: (_, x) => (x == null ? "–" : names[x - 1]) },
      ...runs.map((run, i) => {
        const points = { fill: silmesh.colour("--ground") };
        return { label: run.variant, ...silmesh.style(places[i]), value, points };
      }),
    ];
    const scales = {
      x: { time: false, range: [0.5, names.length + 0.5] },
      y: { range: (_, low) => [Math.max(0, Math.min(low - 0.02, 0.9)), 1] },
    };
    const axes = [{ label: "view", incrs: [1, 2, 5, 10, 20, 50, 100] }, { label: "IoU", size: 60 }];
    return { data, options: { series, scales, axes } };
  }
  silmesh.chart(box, describe);
};
