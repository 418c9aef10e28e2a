// The selected instant of the run in every view; slider, keys, clicks and playback select it.

const ARROWS = "→↗↑↖←↙↓↘";

// `begin` shows a run, `grow` adds new samples, `seek` selects an instant.
function makePlayer() {
  const at = (id) => document.getElementById(id);
  const slider = at("slider"), play = at("play"), speed = at("speed");
  let series = null, times = [], last = 0, plots = null, drawn = [], rows = [];
  let index = -1, playing = 0, t = 0, moved = () => {};

  function begin(columns) {
    stop();
    if (plots) plots.remove();
    series = columns;
    times = series.t[0];
    index = -1;
    plots = makePlots(series, (time) => { choose(time); });
    drawn = [makeScene(series), makeRuler(series), makeTaxels(series)];
    rows = [...document.querySelectorAll("button.at")].map((at) => [at.closest("tr"), Number(at.dataset.t)]);
    measure();
  }
  function grow() {
    measure();
    plots.grow();
  }
  function measure() {
    last = times.length - 1;
    slider.max = last;
  }

  const seek = (time) => {
    t = Math.min(Math.max(time, times[0]), times[last]);
    show(sampleAt(times, t));
  };
  // by the user
  const choose = (time) => { stop(); moved(); seek(time); };

  function show(i) {
    if (i === index && !data.live) return;
    index = i;
    slider.value = i;
    const phase = phaseAt(times[i]);
    at("clock").textContent = `${times[i].toFixed(2)} s`;
    slider.setAttribute("aria-valuetext", `${times[i].toFixed(2)} seconds, ${phase}`);
    drawn.forEach((draw) => draw(i));
    plots.at(times[i]);
    showValues(i, phase);
    // highlight the last row of each table at or before this instant
    rows.forEach(([row, from], n) => {
      const next = rows[n + 1];
      const current = from <= times[i] + 1e-3 && (!next || next[0].parentElement !== row.parentElement || next[1] > times[i] + 1e-3);
      row.classList.toggle("current", current);
    });
  }

  function showValues(i, phase) {
    data.fingers.forEach((finger, f) => {
      if (series.true) at(`true-${finger}`).textContent = digits(series.true[f][i], 2);
      at(`estimated-${finger}`).textContent = digits(series.estimated[f][i], 2);
      if (series.probability) at(`probability-${finger}`).textContent = digits(series.probability[f][i], 3);
      if (series.reported_speed) at(`reported-${finger}`).textContent = motionText(f, i);
      if (series.positions) at(`positions-${finger}`).textContent = digits(series.positions[f][i], 0);
    });
    at("phase").textContent = phase;
    if (!series.status) return;
    const status = series.status[0][i];
    at("status").textContent = !(status & 1) ? "not monitored" : `slip ${status & 4 ? "REGISTERED" : "nominal"}${status & 2 ? " (masked)" : ""}`;
    at("status").className = status & 4 ? "registered" : "";
    if (!series.slip) return;
    const aside = series.across[0][i] * 1e3;
    const turned = series.turn[0][i] * 180 / Math.PI;
    at("world").textContent = (held(i) ? ` · slid ${digits(series.slip[0][i] * 1e3, 1)} mm` : " · not touched") +
      (Math.abs(aside) >= 0.1 ? `, ${aside.toFixed(1)} mm aside` : "") +
      (Math.abs(turned) >= 0.1 ? `, turned ${turned.toFixed(1)}°` : "") + ` · ${digits(series.height[0][i] * 1e3, 0)} mm above the table`;
  }

  // speed, direction as an arrow in the pad's frame (x right, y up), probability of rotation
  const motionText = (f, i) => {
    const speed = series.reported_speed[f][i];
    if (!Number.isFinite(speed)) return "–";
    const direction = series.reported_direction ? ` ${ARROWS[Math.round(series.reported_direction[f][i] / 45) % 8]}; ${series.reported_turning[f][i].toFixed(2)}` : "";
    return `${(speed * 1e3).toFixed(0)}${direction}`;
  };

  const held = (i) => series.true.some((finger) => finger[i] > TOUCH_N);
  const digits = (value, n) => (Number.isFinite(value) ? value.toFixed(n) : "–");
  const phaseAt = (time) => data.phases.reduce((name, phase) => (phase.t <= time + 1e-3 ? named(phase) : name), "");

  function start() {
    moved();
    if (index === last) seek(times[0]);
    let before = performance.now();
    const frame = (now) => {
      seek(t + (now - before) * 1e-3 * Number(speed.value));
      before = now;
      if (index === last) stop();
      else playing = requestAnimationFrame(frame);
    };
    playing = requestAnimationFrame(frame);
    play.textContent = "pause";
  }
  function stop() {
    cancelAnimationFrame(playing);
    playing = 0;
    play.textContent = "play";
  }
  const step = (samples) => choose(times[Math.min(Math.max(index + samples, 0), last)]);
  const next = () => choose((data.phases.find((p) => p.t > times[index] + 1e-3) || {t: times[last]}).t);
  const before = () => choose((data.phases.findLast((p) => p.t < times[index] - 1e-3) || {t: times[0]}).t);
  const toggle = () => (playing ? stop() : start());

  function recolour() {
    if (plots) plots.recolour();
    redrawScene();
  }

  // the button offers the other range
  function zoom(near) {
    plots.zoom(near);
    at("span").textContent = near ? "whole run" : "one second";
  }

  function addListeners() {
    slider.addEventListener("input", () => choose(times[slider.value]));
    play.addEventListener("click", toggle);
    at("span").addEventListener("click", () => zoom(at("span").textContent !== "whole run"));
    at("on").addEventListener("click", next);
    at("back").addEventListener("click", before);
    document.addEventListener("click", (event) => {
      if (event.target.matches("button.at")) choose(Number(event.target.dataset.t));
    });
    document.addEventListener("keydown", (event) => {
      const where = event.target;
      if (!series || event.ctrlKey || event.altKey || event.metaKey || where.matches("select")) return;
      if (event.key === " " && where.matches("button, summary")) return; // these elements handle the key
      const actions = {
        " ": toggle, n: next, p: before, Home: () => step(-last), End: () => step(last),
        ArrowLeft: () => step(event.shiftKey ? -10 : -1), ArrowRight: () => step(event.shiftKey ? 10 : 1),
      };
      if (!(event.key in actions)) return;
      event.preventDefault();
      actions[event.key]();
    });
    // canvases keep their colours: redraw when the colour scheme changes, and in light colours to print
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
    for (const [event, paper] of [["beforeprint", true], ["afterprint", false]]) {
      addEventListener(event, () => {
        document.documentElement.classList.toggle("paper", paper);
        if (!plots) return;
        plots.print(paper);
        recolour();
      });
    }
  }
  addListeners();
  return {begin, grow, seek, zoom, latest: () => seek(times[last]), onMove: (hook) => { moved = hook; }};
}

function complain(error) {
  const line = document.getElementById("error");
  line.textContent = `Pictures and plots cannot be drawn in this browser: ${error.message}`;
  line.hidden = false;
}
