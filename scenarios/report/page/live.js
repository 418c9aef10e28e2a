// A run in progress: rows arrive over a socket; the newest is shown until the user moves the slider.

const MAX_NOTES = 200;
const DRAW_MS = 100; // between two redraws: the control loop may run on the same processor

function followRun() {
  const at = (id) => document.getElementById(id);
  const player = makePlayer();
  let series = null, following = true, waiting = false;

  player.onMove(() => { following = false; });
  at("follow").addEventListener("click", () => { following = true; draw(); });
  at("speed").value = "1";

  function begin(message) {
    Object.assign(data, message.data, {phases: [], marks: []});
    series = {};
    at("progress").textContent = message.of > 1 ? `· ${message.number} of ${message.of}` : "";
    following = true;
    started = false;
  }

  // null stands for NaN
  function add(row) {
    if (!series.t) state("live", "success");
    for (const [name, values] of Object.entries(row.values)) {
      series[name] ??= values.map(() => []);
      values.forEach((value, k) => series[name][k].push(value === null ? NaN : value));
    }
    const last = series.t[0].length - 1, t = series.t[0][last];
    const phase = data.phases[data.phases.length - 1];
    if (!phase || phase.name !== row.phase) data.phases.push({t, name: row.phase});
    mark("impact", "tap", series.impact && series.impact[0][last]);
    mark("onset", "slip begins", series.onset && series.onset[0][last]);
    if (series.status && series.status[0][last] & 4) mark("registered", "slip registered", t);
  }

  function mark(kind, name, t) {
    if (Number.isFinite(t) && !data.marks.some((known) => known.kind === kind)) data.marks.push({kind, name, t});
  }

  function showNote(text) {
    const line = document.createElement("li");
    line.textContent = text;
    at("notes").prepend(line);
    while (at("notes").childElementCount > MAX_NOTES) at("notes").lastChild.remove();
    at("note").textContent = text.replace(/ {2,}(?=[a-z])/g, ", ");
  }

  function take(messages) {
    for (const message of messages) {
      if (message.type === "Begin") begin(message);
      else if (message.type === "Row" && series) add(message);
      else if (message.type === "Note") showNote(message.text);
    }
    draw();
  }

  let started = false;
  function draw() {
    if (waiting || !series?.t) return;
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
