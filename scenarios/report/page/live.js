// A run that lasts: rows come over a socket, and the newest is shown until somebody moves the slider.

const MOST_SAID = 200;
const DRAW_MS = 100; // between two pictures: the run may need the processor more

function followRun() {
  const at = (id) => document.getElementById(id);
  const player = makePlayer();
  let series = null, following = true, waiting = false;

  player.onMove(() => { following = false; });
  at("follow").addEventListener("click", () => { following = true; draw(); });
  at("speed").value = "1";

  function begin(told) {
    Object.assign(data, told.data, {phases: [], marks: []});
    series = {};
    for (const [name, width] of data.columns) series[name] = Array.from({length: width}, () => []);
    at("progress").textContent = told.of > 1 ? `· ${told.number} of ${told.of}` : "";
    following = true;
    started = false;
    state("live", "success");
  }

  // null is no number
  function add(row) {
    let place = 0;
    for (const [name, width] of data.columns) {
      for (let k = 0; k < width; k++) {
        const value = row.values[place++];
        series[name][k].push(value === null ? NaN : value);
      }
    }
    const last = series.t[0].length - 1, t = series.t[0][last];
    const phase = data.phases[data.phases.length - 1];
    if (!phase || phase.name !== row.phase) data.phases.push({t, name: row.phase});
    mark("struck", "tap", series.struck && series.struck[0][last]);
    mark("onset", "slip begins", series.onset && series.onset[0][last]);
    if (series.status && series.status[0][last] & 4) mark("registered", "slip registered", t);
  }

  function mark(kind, name, t) {
    if (Number.isFinite(t) && !data.marks.some((known) => known.kind === kind)) data.marks.push({kind, name, t});
  }

  function say(text) {
    const line = document.createElement("li");
    line.textContent = text;
    at("told").prepend(line);
    while (at("told").childElementCount > MOST_SAID) at("told").lastChild.remove();
    at("said").textContent = text;
  }

  function take(messages) {
    for (const message of messages) {
      if (message.type === "Begin") begin(message);
      else if (message.type === "Row" && series) add(message);
      else if (message.type === "Said") say(message.text);
    }
    draw();
  }

  let started = false;
  function draw() {
    if (waiting || !series || !series.t[0].length) return;
    waiting = true;
    setTimeout(() => requestAnimationFrame(() => {
      waiting = false;
      if (started) player.grow();
      else player.begin(series);
      started = true;
      if (following) player.latest();
      document.documentElement.dataset.rows = series.t[0].length;
    }), DRAW_MS);
  }

  function state(word, kind) {
    at("state").textContent = word;
    at("state").className = `badge ${kind}`;
  }

  const socket = new WebSocket(`${location.href.replace(/^http/, "ws")}live`);
  socket.addEventListener("message", (event) => {
    try { take(JSON.parse(event.data)); } catch (error) { complain(error); }
  });
  socket.addEventListener("close", () => state(series ? "over" : "gone", ""));
  document.documentElement.dataset.ready = "yes";
}

followRun();
