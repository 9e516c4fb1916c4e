/* Draws the charts of a report with uPlot: linked in time, by mouse, buttons and keys. */
(() => {
  "use strict";
  const DATA = JSON.parse(document.getElementById("data").textContent);
  const ROOT = document.documentElement, SAID = document.getElementById("said");
  const THEME = document.getElementById("theme");
  const DARK = matchMedia("(prefers-color-scheme: dark)");
  const TIME = DATA.rt.concat(DATA.t);
  const FIRST = TIME[0], LAST = TIME[TIME.length - 1];
  const WIDTH_ON_PAPER = 680, SHARPER = 2.5;
  let charts = [], shown = [FIRST, LAST];

  const color = name => getComputedStyle(ROOT).getPropertyValue("--" + name).trim();
  const nulls = count => new Array(count).fill(null);

  /* uPlot's data and series of a chart; a band is its upper and its lower edge. */
  function columns(chart, size) {
    const data = [chart.x || TIME], series = [{}], bands = [], owners = [];
    const place = (values, at) => chart.x ? values : at === "recording"
      ? values.concat(nulls(DATA.t.length)) : nulls(DATA.rt.length).concat(values);
    const looks = {
      estimate: {stroke: color("estimate"), width: 1.6 * size},
      output: {stroke: color("output"), width: 1.2 * size},
      truth: {stroke: color("truth"), width: 4.5 * size, alpha: 0.6},
      recorded: {stroke: color("recorded"), width: 1.6 * size},
      limit: {stroke: color("limit"), width: 1.4 * size, dash: [6 * size, 4 * size]},
      bar: {fill: color("output"), width: 0, paths: uPlot.paths.bars({size: [0.5, 30 * size]})},
      dots: {stroke: color("estimate"), paths: () => null,
        points: {show: true, size: 5 * size, fill: color("estimate")}},
      mark: {stroke: color("mark"), paths: () => null,
        points: {show: true, size: 6 * size, fill: color("mark")}},
    };
    chart.curves.forEach((curve, k) => {
      if (curve.look === "band") {
        bands.push({series: [series.length, series.length + 1], fill: color("band")});
        const lower = curve.v || curve.u.map(v => v === null ? null : -v);
        for (const edge of [curve.u, lower]) {
          series.push({points: {show: false}, width: 0});
          data.push(place(edge, curve.at));
          owners.push(k);
        }
      } else {
        series.push({points: {show: false}, ...looks[curve.look]});
        data.push(place(curve.v, curve.at));
        owners.push(k);
      }
    });
    if (Object.keys(chart.lanes).length) {
      series.push({points: {show: false}});
      data.push(TIME.map(() => null));
    }
    return {data, series, bands, owners};
  }

  /* Spans of time as areas of the chart; the thinnest is one pixel wide. */
  function shade(u, spans, fill, top, height) {
    u.ctx.fillStyle = fill;
    const {left, width} = u.bbox;
    for (const [from, to] of spans) {
      const a = Math.max(u.valToPos(from, "x", true), left);
      const b = Math.min(u.valToPos(to, "x", true), left + width);
      if (b > left && a < left + width) u.ctx.fillRect(a, top, Math.max(b - a, 1), height);
    }
  }

  function background(u, chart) {
    const {top, height} = u.bbox, lanes = Object.entries(chart.lanes);
    if (chart.doubts)
      for (const [name, spans] of Object.entries(DATA.doubts))
        if (name !== "outside") shade(u, spans, color(name), top, height);
    const each = height / Math.max(lanes.length, 1);
    lanes.forEach(([name, spans], i) =>
      shade(u, spans, color(name), top + (i + 0.15) * each, 0.7 * each));
  }

  function foreground(u, chart, size) {
    const {left, top, width, height} = u.bbox, ctx = u.ctx;
    const ratio = devicePixelRatio * size;
    for (const [at, words] of chart.marks) {
      const x = u.valToPos(at, "x", true);
      ctx.save();
      ctx.strokeStyle = ctx.fillStyle = color("limit");
      ctx.lineWidth = 1.4 * ratio;
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
      ctx.font = `${12 * ratio}px system-ui, sans-serif`;
      const room = ctx.measureText(words).width + 8 * ratio;
      ctx.textAlign = x + room > left + width ? "right" : "left";
      ctx.fillText(words, x + (ctx.textAlign === "left" ? 5 : -5) * ratio, top + 14 * ratio);
      ctx.restore();
    }
  }

  function axes(chart, size) {
    const lanes = Object.keys(chart.lanes), font = `${12 * size}px system-ui, sans-serif`;
    const look = {stroke: color("soft"), font, labelFont: font,
      grid: {stroke: color("grid"), width: size}, ticks: {stroke: color("grid"), width: size}};
    const y = {...look, size: 72 * size, gap: 5 * size, space: 28 * size};
    if (lanes.length) {
      y.splits = () => lanes.map((_, i) => lanes.length - i - 0.5);
      y.values = () => lanes;
      y.grid = {show: false};
    } else {
      y.values = (u, splits) => splits.map(v => v === null ? "" : short(v));
      if (chart.log) [y.splits, y.filter] = [decades, (u, splits) => splits];
    }
    return [{...look, label: chart.xl, labelSize: 18 * size, size: 30 * size, gap: 4 * size,
      space: 60 * size, values: (u, splits) => splits.map(v => v === null ? "" : short(v))}, y];
  }

  /* Decades of a logarithmic axis, at most seven; of a short one 2 and 5 between them. */
  function decades(u, axis, min, max) {
    const first = Math.floor(Math.log10(min)), last = Math.ceil(Math.log10(max));
    const step = Math.max(1, Math.ceil((last - first) / 7)), splits = [];
    for (let power = first; power <= last; power += step)
      for (const lead of last - first < 3 ? [1, 2, 5] : [1])
        splits.push(lead * 10 ** power);
    return splits.filter(v => v >= min * 0.999 && v <= max * 1.001);
  }

  const short = v => {
    const size = Math.abs(v);
    return size !== 0 && (size >= 1e6 || size < 1e-4) ? v.toExponential(1)
      : String(parseFloat(v.toPrecision(8)));
  };

  function scales(chart) {
    const lanes = Object.keys(chart.lanes).length;
    const x = {time: false};
    const edge = chart.curves.some(curve => curve.look === "bar") ? 0.6 : 0;
    if (!chart.x) x.range = (u, min, max) => min === null ? [FIRST, LAST] : [min, max];
    else x.range = (u, min, max) => [min - edge, max + edge];
    const y = chart.log ? {distr: 3} : {range: (u, min, max) => {
      if (lanes) return [0, lanes];
      if (min === null) return chart.view || [0, 1];
      const [lo, hi] = uPlot.rangeNum(min, max, 0.06, true);
      return chart.view && chart.view[0] < chart.view[1]
        && Math.max(lo, chart.view[0]) < Math.min(hi, chart.view[1])
        ? [Math.max(lo, chart.view[0]), Math.min(hi, chart.view[1])] : [lo, hi];
    }};
    return {x, y};
  }

  function build(size, width) {
    const {data, series, bands, owners} = columns(this.chart, size);
    const chart = this.chart, host = this.host, lanes = Object.keys(chart.lanes).length;
    if (this.u) this.u.destroy();
    host.style.zoom = 1 / size;
    const options = {
      width: Math.max(Math.floor(width * size), 120),
      height: (lanes ? 70 + 26 * lanes : 210) * size,
      series, bands, scales: scales(chart), axes: axes(chart, size), legend: {show: false},
      cursor: {drag: {x: true, y: false}, y: false, points: {size: 7 * size},
        ...(chart.x ? {} : {sync: {key: "time", scales: ["x", null]}})},
      hooks: {
        drawClear: [u => background(u, chart)],
        draw: [u => foreground(u, chart, size)],
        setScale: [(u, key) => { if (key === "x" && !chart.x) link(u); }],
        setCursor: [u => values(this, owners)],
      },
    };
    this.u = new uPlot(options, data, host);
    if (!chart.x && (shown[0] !== FIRST || shown[1] !== LAST))
      this.u.setScale("x", {min: shown[0], max: shown[1]});
  }

  /* All charts over time show the same span. */
  function link(u) {
    const {min, max} = u.scales.x;
    if (min === null || (min === shown[0] && max === shown[1])) return;
    shown = [min, max];
    for (const one of charts)
      if (!one.chart.x && one.u && one.u !== u) one.u.setScale("x", {min, max});
  }

  /* What the curves are at the cursor, in the legend. */
  function values(one, owners) {
    const {idx} = one.u.cursor, texts = one.outputs.map(() => []);
    if (idx !== null && idx !== undefined)
      owners.forEach((k, i) => {
        const v = one.u.data[i + 1][idx];
        if (v !== null && v !== undefined) texts[k].push(parseFloat(v.toPrecision(4)));
      });
    one.outputs.forEach((output, k) => {
      output.textContent = texts[k].length ? texts[k].reverse().join(" to ") : "";
    });
  }

  function show(from, to) {
    const span = Math.min(to - from, LAST - FIRST);
    const min = Math.max(FIRST, Math.min(from, LAST - span)), max = min + span;
    const one = charts.find(c => !c.chart.x);
    if (one && span > 0) one.u.setScale("x", {min, max});
    SAID.textContent = `from ${short(parseFloat(min.toPrecision(5)))} to `
      + short(parseFloat(max.toPrecision(5)));
  }

  const MOVES = {
    in: (a, b) => [a + (b - a) / 4, b - (b - a) / 4],
    out: (a, b) => [a - (b - a) / 2, b + (b - a) / 2],
    left: (a, b) => [a - (b - a) / 4, b - (b - a) / 4],
    right: (a, b) => [a + (b - a) / 4, b + (b - a) / 4],
    all: () => [FIRST, LAST],
  };
  const KEYS = {"+": "in", "=": "in", "-": "out", "0": "all", Escape: "all"};
  const move = name => show(...MOVES[name](...shown));

  /* Keys in a chart: arrows move the cursor, with shift the time; + - 0 zoom. */
  function key(event, one) {
    const u = one.u, side = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (side && event.shiftKey && !one.chart.x) move(side < 0 ? "left" : "right");
    else if (side) {
      const [a, b] = [u.scales.x.min, u.scales.x.max].map(v => u.valToIdx(v));
      const now = u.cursor.idx === null || u.cursor.left < 0
        ? (side > 0 ? a - 1 : b + 1) : u.cursor.idx;
      const far = Math.max(1, Math.round((b - a) / 100));
      const next = Math.min(Math.max(now + side * far, a), b);
      u.setCursor({left: u.valToPos(u.data[0][next], "x"), top: u.over.clientHeight / 2});
      const said = one.outputs.map(o => o.textContent && o.parentNode.textContent.trim());
      SAID.textContent = `${one.chart.xl} ${short(u.data[0][next])}: `
        + said.filter(Boolean).join("; ");
    } else if (KEYS[event.key] && !one.chart.x) move(KEYS[event.key]);
    else return;
    event.preventDefault();
  }

  function draw(size, width) {
    for (const one of charts) build.call(one, size, width || one.host.parentNode.clientWidth);
  }

  function paint() {
    const dark = THEME.value === "dark" || (THEME.value === "auto" && DARK.matches);
    ROOT.dataset.theme = dark ? "dark" : "light";
    draw(1);
  }

  charts = DATA.charts.map((chart, i) => {
    const figure = document.getElementById(`chart-${i}`);
    const one = {chart, host: figure.querySelector(".plot"),
      outputs: [...figure.querySelectorAll("output")]};
    one.host.addEventListener("keydown", event => key(event, one));
    return one;
  });
  paint();
  THEME.addEventListener("change", paint);
  DARK.addEventListener("change", paint);
  for (const button of document.querySelectorAll(".toolbar button"))
    button.addEventListener("click", () => move(button.dataset.do));
  document.querySelector(".toolbar").hidden = !charts.some(one => !one.chart.x);
  let width = ROOT.clientWidth;
  addEventListener("resize", () => {
    if (ROOT.clientWidth === width) return;
    width = ROOT.clientWidth;
    draw(1);
  });
  addEventListener("beforeprint", () => {
    ROOT.dataset.theme = "light";
    draw(SHARPER, WIDTH_ON_PAPER);
  });
  addEventListener("afterprint", paint);
})();
