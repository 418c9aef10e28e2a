// The plots over time, by uPlot, with a common time scale and playhead.

const AXIS_PX = 46;
const PAPER_PX = 400; // of a plot beside the scene on an upright sheet of A4 or Letter
const TOUCH_N = 1e-3; // less is no touch
const NEAR_S = [-0.3, 0.7]; // time range around the selected instant when zoomed in
const ROW_PX = 13; // height of a mark's name
const MARKS_PX = 3 * ROW_PX + 4; // room above the first plot, so that no name covers a curve
const NAMES_PX = 16; // room to the right of the plots for the names of the fingers
const HEIGHTS = {force: 210 + MARKS_PX, probability: 150, decided: 130, reported: 110, slip: 120};

// Lines have functions as values, because a run in progress grows.
function makePlots(series, seek) {
  const times = () => Array.from(series.t[0], (t) => t);
  const shown = (values) => Array.from(values, (v) => (Number.isNaN(v) ? null : v));
  const plots = {}, heads = [], drawn = {};
  let linked = false; // while one plot hands its scale to the others

  function add(name, lines, bounds, draw = []) {
    const holder = document.getElementById(`plot-${name}`);
    if (!holder) return;
    legend(name, lines);
    const options = {
      width: holder.clientWidth,
      height: HEIGHTS[name],
      padding: [name === "force" ? MARKS_PX : null, NAMES_PX, null, null],
      legend: {show: false},
      cursor: {points: {show: false}, y: false, drag: {x: true, y: false}, focus: {prox: -1}},
      scales: {x: {time: false}, y: {range: bounds}},
      axes: [axis({values: (u, ticks) => ticks.map((t) => `${+t.toFixed(3)}`), size: 26}), axis({size: AXIS_PX})],
      series: [{}, ...lines.map((line) => ({
        label: line.name, stroke: () => colour(line.colour), width: line.width || 1.5, dash: line.dash, points: {show: false},
      }))],
      hooks: {drawClear: draw, setScale: [(u, key) => key === "x" && share(u)], draw: [drawMarks, drawNames]},
    };
    drawn[name] = () => [times(), ...lines.map((line) => shown(line.values()))];
    const plot = new uPlot(options, drawn[name](), holder);
    const head = document.createElement("div");
    head.className = "playhead";
    plot.over.append(head);
    heads.push([plot, head]);
    // a click, not a drag
    let down = 0;
    plot.over.addEventListener("mousedown", (event) => { down = event.clientX; });
    plot.over.addEventListener("mouseup", (event) => {
      if (Math.abs(event.clientX - down) < 4) seek(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
    });
    plots[name] = plot;
  }

  function share(from) {
    if (linked) return;
    linked = true;
    const {min, max} = from.scales.x;
    for (const plot of Object.values(plots)) if (plot !== from) plot.setScale("x", {min, max});
    linked = false;
    drawStrip(min, max, from.width);
    placeHeads();
  }

  let now = 0;
  function placeHeads() {
    for (const [plot, head] of heads) {
      const left = plot.valToPos(now, "x");
      head.style.transform = `translateX(${left}px)`;
      head.hidden = left < 0 || left > plot.over.clientWidth;
    }
  }

  const fingers = data.fingers.map((name, i) => ({name, colour: `finger${i}`}));
  const of = (column, i) => () => series[column][i];
  const level = (name, value) => ({name, colour: "limit", dash: [6, 4], width: 1, values: () => times().map(() => value)});
  const probable = data.rule && data.rule.probable;

  const trueLines = series.true ? fingers.map((finger, i) => ({...finger, values: of("true", i)})) : [];
  const estimated = fingers.map((finger, i) => ({...finger, values: of("estimated", i), width: 1, dash: series.true ? [2, 2] : undefined}));
  const limits = data.limit_n ? [level(`limit ${data.limit_n} N`, data.limit_n)] : [];
  add("force", [...estimated, ...trueLines, ...limits], (u, low, high) => [0, Math.max(1.08 * high, 1.15 * (data.limit_n || 1))], [shadePhases]);

  if (data.rule) {
    const each = fingers.map((finger, i) => ({...finger, values: of("probability", i), width: 1}));
    const own = probable ? [level(`threshold ${data.rule.limit}`, data.rule.limit)] : [];
    if (series.decided && probable) own.unshift({name: data.rule.label, colour: "ink", width: 1.8, values: of("decided", 0)});
    add("probability", [...each, ...own], () => [0, 1.02], [shadePhases, shadeStatus(series)]);
  }
  if (series.decided && !probable) {
    const alone = series.decided.length === 1;
    const sums = series.decided.map((_, i) => ({...(alone ? {name: "all fingers", colour: "ink"} : fingers[i]), values: of("decided", i)}));
    add("decided", [...sums, level(`limit ${data.rule.limit}`, data.rule.limit)], (u, low, high) => [0, 1.15 * Math.min(Math.max(high, data.rule.limit), 8 * data.rule.limit)], [shadePhases, shadeStatus(series)]);
  }
  if (series.reported_speed) {
    const lines = data.fingers.length === series.reported_speed.length
      ? fingers.map((finger, i) => ({...finger, width: 1.2, values: () => Array.from(series.reported_speed[i], (v) => v * 1e3)})) : [];
    if (series.slip_speed) lines.unshift({name: "true, down", colour: "soft", width: 1, values: () => inHand(series, series.slip_speed[0])});
    add("reported", lines, (u, low, high) => [Math.min(0, 1.1 * low), Math.max(20, 1.1 * high)], [shadePhases]);
  }
  if (series.slip) {
    const lines = [{name: "down", colour: "ink", values: () => inHand(series, series.slip[0])}];
    const aside = () => inHand(series, series.across[0]);
    if (data.live || aside().some((mm) => Math.abs(mm) > 0.1)) lines.push({name: "aside", colour: "ink", dash: [5, 3], values: aside});
    add("slip", lines, (u, low, high) => [Math.min(-0.2, 1.1 * low), Math.max(2, 1.1 * high)], [shadePhases]);
  }

  function resize(width) {
    for (const plot of Object.values(plots)) if (plot.width !== width) plot.setSize({width, height: plot.height});
    drawStrip(plots.force.scales.x.min, plots.force.scales.x.max, width);
    placeHeads();
  }
  const holder = document.getElementById("plot-force");
  const watched = new ResizeObserver(() => resize(holder.clientWidth));
  watched.observe(holder);
  const ends = () => [series.t[0][0], series.t[0][series.t[0].length - 1]];
  drawStrip(...ends(), plots.force.width);

  return {
    at: (t) => { now = t; placeHeads(); },
    // new samples
    grow: () => {
      for (const [name, plot] of Object.entries(plots)) plot.setData(drawn[name]());
    },
    remove: () => {
      Object.values(plots).forEach((plot) => plot.destroy());
      watched.disconnect();
    },
    zoom: (near) => {
      const [min, max] = near ? NEAR_S.map((s) => now + s) : ends();
      plots.force.setScale("x", {min, max});
    },
    recolour: () => Object.values(plots).forEach((plot) => plot.redraw()),
    // the width of the paper is not known before its layout
    print: (paper) => resize(paper ? Math.min(PAPER_PX, holder.clientWidth) : holder.clientWidth),
  };
}

// In mm, while a finger touches the object; without contact there is no slip.
function inHand(series, metres) {
  return Array.from(metres, (m, i) => (series.true.some((finger) => finger[i] > TOUCH_N) ? m * 1e3 : NaN));
}

function axis(more) {
  return {
    stroke: () => colour("soft"), font: "12px system-ui, sans-serif", ...more,
    grid: {stroke: () => colour("grid"), width: 1}, ticks: {stroke: () => colour("grid"), width: 1, size: 4},
  };
}

function legend(name, lines) {
  const root = document.getElementById(`legend-${name}`);
  root.replaceChildren();
  const named = new Set();
  for (const line of lines) {
    if (named.has(line.name)) continue; // estimated and true force of a finger have one colour
    named.add(line.name);
    const sample = document.createElement("i");
    sample.className = `line ${line.colour}${line.dash && line.colour !== "ink" && name !== "force" || line.colour === "limit" || line.name === "aside" ? " dashed" : ""}`;
    const item = document.createElement("span");
    item.append(sample, line.name);
    root.append(item);
  }
  if (name === "force" && lines.length > 4) root.append(" (full: true, dotted: estimated)");
}

// Background of the plots: every other phase, and masked or registered intervals.
function shadePhases(u) {
  const {left, width, top, height} = u.bbox;
  u.ctx.save();
  u.ctx.fillStyle = colour("shade");
  data.phases.forEach((phase, i) => {
    if (i % 2) return;
    const next = data.phases[i + 1];
    const from = Math.max(left, u.valToPos(phase.t, "x", true));
    const to = Math.min(left + width, next ? u.valToPos(next.t, "x", true) : left + width);
    if (to > from) u.ctx.fillRect(from, top, to - from, height);
  });
  u.ctx.restore();
}

function shadeStatus(series) {
  return (u) => {
    const {left, width, top, height} = u.bbox;
    u.ctx.save();
    for (const span of statusSpans(series)) {
      const from = Math.max(left, u.valToPos(span.from, "x", true)), to = Math.min(left + width, u.valToPos(span.to, "x", true));
      u.ctx.fillStyle = colour(span.kind);
      if (to > from) u.ctx.fillRect(from, top, to - from, height);
    }
    u.ctx.restore();
  };
}

function statusSpans(series) {
  const spans = [];
  series.status[0].forEach((status, i) => {
    const kind = status & 2 ? "masked" : status & 4 ? "registered" : "";
    const last = spans[spans.length - 1];
    const t = series.t[0][i];
    if (last && last.kind === kind) last.to = t;
    else { if (last) last.to = t; spans.push({kind, from: t, to: t}); }
  });
  return spans.filter((span) => span.kind);
}

function drawMarks(u) {
  const {left, width, top, height} = u.bbox, ratio = devicePixelRatio || 1;
  u.ctx.save();
  u.ctx.strokeStyle = u.ctx.fillStyle = colour("limit");
  u.ctx.font = `${11 * ratio}px system-ui, sans-serif`;
  u.ctx.lineWidth = ratio;
  const first = u.root.parentElement.id === "plot-force";
  data.marks.forEach((mark, row) => {
    const x = u.valToPos(mark.t, "x", true);
    if (x < left || x > left + width) return;
    u.ctx.beginPath();
    // marks can be close together: each name has its own row, on the side with more space
    const y = first ? top - (4 + ROW_PX * row) * ratio : top;
    u.ctx.moveTo(x, y);
    u.ctx.lineTo(x, top + height);
    u.ctx.stroke();
    if (!first) return;
    const right = x < left + 110 * ratio;
    u.ctx.textAlign = right ? "left" : "right";
    u.ctx.fillText(mark.name, x + (right ? 4 : -4) * ratio, y);
  });
  u.ctx.restore();
}

// The name of each finger at the end of its curve, so that colour alone does not tell them apart.
function drawNames(u) {
  const {left, width, top, height} = u.bbox, ratio = devicePixelRatio || 1, [, last] = u.series[0].idxs;
  const ends = new Map(); // the true force, drawn last, replaces the estimate
  u.series.forEach((line, k) => {
    if (!data.fingers.includes(line.label)) return;
    let i = last;
    while (i > 1 && (u.data[k][i] === null || u.data[k][i - 1] === null)) i--; // a lone point draws no line
    const x = u.valToPos(u.data[0][i], "x", true), y = u.valToPos(u.data[k][i], "y", true);
    if (u.data[k][i] !== null && x >= left) ends.set(line.label, {name: line.label, colour: line.stroke(u, k), x: Math.min(x, left + width) + 4 * ratio, y});
  });
  u.ctx.save();
  u.ctx.font = `600 ${11 * ratio}px system-ui, sans-serif`;
  u.ctx.textAlign = "left";
  u.ctx.textBaseline = "middle";
  // from bottom to top, each above the one below
  let free = top + height;
  [...ends.values()].sort((a, b) => b.y - a.y).forEach(({name, colour, x, y}) => {
    free = Math.min(y, free);
    u.ctx.fillStyle = colour;
    u.ctx.fillText(name, x, free);
    free -= 11 * ratio;
  });
  u.ctx.restore();
}

const named = (phase) => data.phase_names[phase.name] ?? phase.name;

// Names of the phases above the plots, where they fit.
function drawStrip(from, to, width) {
  const strip = document.getElementById("strip");
  strip.replaceChildren();
  const wide = width - AXIS_PX;
  data.phases.forEach((phase, i) => {
    const end = i + 1 < data.phases.length ? data.phases[i + 1].t : to;
    const left = Math.max(0, (phase.t - from) / (to - from)), right = Math.min(1, (end - from) / (to - from));
    if (right <= left) return;
    const box = document.createElement("span");
    box.className = `phase ${i % 2 ? "" : "even"}`;
    box.style.left = `${AXIS_PX + left * wide}px`;
    box.style.width = `${(right - left) * wide}px`;
    box.title = named(phase);
    if ((right - left) * wide > 7 * box.title.length) box.textContent = box.title;
    strip.append(box);
  });
}
