"use strict";
// Shared by all pages: data, colours of the light or dark scheme, and SVG helpers.

const data = JSON.parse(document.getElementById("data").textContent);

// Columns as scenarios/report/run_page.py packs them: {name: [Float32Array, ...]}, NaN where a value is missing.
async function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.deflated), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const values = new Float32Array(await new Response(stream).arrayBuffer());
  const columns = {};
  let place = 0;
  for (const [name, width] of packed.columns) {
    columns[name] = Array.from({length: width}, () => values.subarray(place, place += packed.rows));
  }
  return columns;
}

// Last sample at or before t.
function sampleAt(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t + 1e-3) low = middle;
    else high = middle - 1;
  }
  return low;
}

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function svg(name, attributes = {}, parent = null, text = null) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== null) element.textContent = text;
  if (parent) parent.append(element);
  return element;
}

function set(element, attributes) {
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
}
