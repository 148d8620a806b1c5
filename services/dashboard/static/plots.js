// Measurements over time, drawn by uPlot: axes with units, zoom by dragging, and one time for all plots and the scene.

import { uPlot } from "./uplot.js";

const COLOURS = ["--c0", "--c1", "--c2"];
const HEIGHT_PX = 150;
const SYNC = "trial";

// A colour of the style sheet as a canvas understands it: resolved for light or dark by an element that wears it.
function styled(name) {
  const wearer = document.createElement("i");
  wearer.style.color = `var(${name})`;
  document.body.append(wearer);
  const colour = getComputedStyle(wearer).color;
  wearer.remove();
  return colour;
}

const spoken = (value, unit) => (Number.isFinite(value) ? `${value.toFixed(Math.abs(value) < 10 ? 2 : 0)}${unit && ` ${unit}`}` : "–");

// The sample that counts at a cursor: its own, or the last one before it.
function lastKnown(u, series, index) {
  const values = u.data[series];
  let at = index;
  while (at > 0 && values[at] == null) at--;
  return at;
}

// The limit within which a goal counts as reached.
function limitLine(limit) {
  return (u) => {
    const { ctx, bbox } = u, y = u.valToPos(limit.value, "y", true);
    if (y < bbox.top || y > bbox.top + bbox.height) return;
    ctx.save();
    Object.assign(ctx, { strokeStyle: styled("--ok"), fillStyle: styled("--ok"), lineWidth: devicePixelRatio, font: `${11 * devicePixelRatio}px sans-serif`, textAlign: "right", textBaseline: "bottom" });
    ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    ctx.fillText(limit.name, bbox.left + bbox.width - 4, y - 2);
    ctx.restore();
  };
}

export class Plot {
  // ``series`` gives [{t, values, name, dashed, colour}]; asked for again whenever something else is to be shown.
  constructor(parent, { title, unit, series, limit }, { duration, seek, hover, zoomed }) {
    Object.assign(this, { title, unit, series, limit, duration, seek, hover, zoomed });
    this.figure = document.createElement("figure");
    this.figure.className = "time-plot";
    this.caption = document.createElement("figcaption");
    this.chart = document.createElement("div");
    this.chart.setAttribute("role", "img");
    this.figure.append(this.caption, this.chart);
    parent.append(this.figure);
    this.renew();
  }

  renew() {
    this.u?.destroy();
    this.u = null;
    const lines = this.series().filter((line) => line.t.length);
    this.figure.hidden = !lines.length;
    if (!lines.length) return;
    this.caption.textContent = this.unit ? `${this.title}, ${this.unit}` : this.title;
    const values = lines.flatMap((line) => [Math.min(...line.values), Math.max(...line.values)]).filter(Number.isFinite);
    this.chart.setAttribute("aria-label", `${this.title}, from ${spoken(Math.min(...values), this.unit)} to ${spoken(Math.max(...values), this.unit)}`);
    const data = uPlot.join(lines.map((line) => [line.t, line.values]));
    this.u = new uPlot(this.options(lines), data, this.chart);
    this.head = document.createElement("div");
    this.head.className = "head";
    this.u.over.append(this.head);
    this.listen();
  }

  options(lines) {
    const ink = styled("--soft"), grid = { stroke: styled("--grid"), width: 1 };
    const axis = { stroke: ink, grid, ticks: grid, font: "11px sans-serif" };
    const low = this.limit ? 0 : undefined;
    return {
      width: Math.max(200, this.chart.clientWidth), height: HEIGHT_PX,
      scales: { x: { time: false, range: (u, from, to) => (Number.isFinite(from) ? [from, to] : [0, this.duration]) },
        y: { range: (u, from, to) => uPlot.rangeNum(low ?? from, this.limit ? Math.max(to, 1.15 * this.limit.value) : to, 0.08, true) } },
      axes: [{ ...axis, size: 28, values: (u, ticks) => ticks.map((tick) => `${tick} s`) }, { ...axis, size: 46 }],
      series: [{ value: (u, at) => (at == null ? "" : `${at.toFixed(2)} s`), label: "time" }, ...lines.map((line, index) => ({
        label: line.name, stroke: styled(COLOURS[(line.colour ?? index) % 3]), width: 1.4, dash: line.dashed ? [5, 4] : undefined,
        spanGaps: true, points: { show: false }, value: (u, value) => (value == null ? "–" : spoken(value, "")),
      }))],
      cursor: { sync: { key: SYNC, setSeries: false }, drag: { x: true, y: false }, dataIdx: (u, series, at) => lastKnown(u, series, at), points: { size: 6 } },
      legend: { live: true },
      hooks: { draw: this.limit ? [limitLine(this.limit)] : [],
        setScale: [(u, key) => key === "x" && this.zoomed(this, u.scales.x.min, u.scales.x.max)],
        setCursor: [(u) => this.hover(u.cursor.left >= 0 && u.cursor.event ? u.posToVal(u.cursor.left, "x") : null)] },
    };
  }

  listen() {
    let pressed = 0;
    this.u.over.addEventListener("pointerdown", (event) => (pressed = event.clientX));
    this.u.over.addEventListener("click", (event) => {
      if (Math.abs(event.clientX - pressed) < 4) this.seek(this.u.posToVal(event.offsetX, "x"));
    });
  }

  show(from, to) {
    const x = this.u?.scales.x;
    if (x && (x.min !== from || x.max !== to)) this.u.setScale("x", { min: from, max: to });
  }

  fit() {
    this.u?.setSize({ width: Math.max(200, this.chart.clientWidth), height: HEIGHT_PX });
  }

  // Where the replay is; the legend tells the values there while no pointer asks for others.
  at(time) {
    if (!this.u) return;
    const left = this.u.valToPos(time, "x");
    this.head.hidden = left < 0 || left > this.u.over.clientWidth;
    this.head.style.transform = `translateX(${left}px)`;
    if (!(this.u.cursor.left >= 0)) this.u.setLegend({ idx: this.u.valToIdx(time) }, false);
  }
}
