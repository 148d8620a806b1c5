// Lines over time on canvases that share one time: the cursor of all stands where the replay is, and a press moves it.

// The processor draws these few lines: through a graphics card that is imitated, as on a server, they take a second.
const DRAWN_BY = { willReadFrequently: true };
const COLOURS = ["--c0", "--c1", "--c2"];

// A colour of the style sheet as a canvas understands it: resolved for light or dark by an element that wears it.
function styled(name) {
  const wearer = document.createElement("i");
  wearer.style.color = `var(${name})`;
  document.body.append(wearer);
  const colour = getComputedStyle(wearer).color;
  wearer.remove();
  return colour;
}

export class Plot {
  // ``series``: functions that give {t, values, name, dashed}; asked for again whenever something else is to be shown.
  constructor(parent, { title, unit, series, band }, duration, seek) {
    Object.assign(this, { title, unit, series, band, duration });
    this.figure = document.createElement("figure");
    this.figure.className = "time-plot";
    this.caption = document.createElement("figcaption");
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.figure.append(this.caption, this.canvas);
    parent.append(this.figure);
    const at = (event) => seek((event.offsetX / this.canvas.clientWidth) * duration);
    this.canvas.addEventListener("pointerdown", (event) => { this.canvas.setPointerCapture(event.pointerId); at(event); });
    this.canvas.addEventListener("pointermove", (event) => this.canvas.hasPointerCapture(event.pointerId) && at(event));
    this.renew();
  }

  renew() {
    this.lines = this.series().filter((line) => line.t.length);
    this.figure.hidden = !this.lines.length;
    let low = Infinity, high = -Infinity;
    for (const line of this.lines) for (const value of line.values) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
    if (this.band !== undefined) [low, high] = [Math.min(low, 0), Math.max(high, this.band)];
    if (!(high > low)) [low, high] = [low - 1, low + 1];
    const room = 0.06 * (high - low);
    [this.low, this.high] = [low - room, high + room];
    this.canvas.setAttribute("aria-label", `${this.title}, from ${low.toPrecision(3)} to ${high.toPrecision(3)} ${this.unit}`);
    this.background = null;
  }

  draw(time) {
    if (this.figure.hidden) return;
    const { canvas } = this, scale = Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (!this.background || canvas.width !== width) {
      [canvas.width, canvas.height] = [width, height];
      this.background = this.lined(width, height, scale);
      this.ink = styled("--text");
    }
    const context = canvas.getContext("2d", DRAWN_BY);
    context.clearRect(0, 0, width, height);
    context.drawImage(this.background, 0, 0);
    const x = (time / this.duration) * width;
    context.fillStyle = this.ink;
    context.fillRect(Math.round(x), 0, scale, height);
    this.say(time);
  }

  lined(width, height, scale) {
    const drawn = new OffscreenCanvas(Math.max(1, width), Math.max(1, height)), context = drawn.getContext("2d", DRAWN_BY);
    const y = (value) => height - ((value - this.low) / (this.high - this.low)) * height;
    if (this.band !== undefined) {
      context.fillStyle = styled("--band");
      context.fillRect(0, y(this.band), width, height);
    }
    context.fillStyle = styled("--line");
    if (this.low < 0 && this.high > 0) context.fillRect(0, y(0), width, scale);
    context.lineWidth = 1.4 * scale;
    context.lineJoin = "round";
    this.lines.forEach((line, index) => {
      context.strokeStyle = styled(COLOURS[(line.colour ?? index) % COLOURS.length]);
      context.globalAlpha = line.dashed ? 0.75 : 1;
      context.setLineDash(line.dashed ? [4 * scale, 3 * scale] : []);
      context.beginPath();
      for (let k = 0; k < line.t.length; k++) context.lineTo((line.t[k] / this.duration) * width, y(line.values[k]));
      context.stroke();
    });
    return drawn;
  }

  say(time) {
    const words = this.lines.filter((line) => line.name).map((line) => {
      const value = line.values[indexAt(line.t, time)];
      const key = document.createElement("span");
      key.className = `c${(line.colour ?? 0) % COLOURS.length}`;
      key.textContent = `${line.name} ${Number.isFinite(value) ? value.toFixed(Math.abs(value) < 10 ? 2 : 0) : "–"}`;
      return key;
    });
    const title = document.createElement("b");
    title.textContent = this.title;
    const unit = document.createElement("span");
    unit.className = "soft";
    unit.textContent = this.unit;
    this.caption.replaceChildren(title, unit, ...words);
  }
}

// The last sample at or before a time.
export function indexAt(t, time) {
  let low = 0, high = t.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (t[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}
