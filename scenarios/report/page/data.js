"use strict";
// What every page shares: its data, and colours that follow the reader's light or dark.

const data = JSON.parse(document.getElementById("data").textContent);
const MISSING = -(2 ** 31);

// Columns as scenarios/report/run_page.py packs them: {name: [Float64Array, ...]}, NaN where nothing is.
async function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.deflated), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const steps = new Int32Array(await new Response(stream).arrayBuffer());
  const columns = {};
  let place = 0;
  for (const [name, width, step] of packed.columns) {
    columns[name] = Array.from({length: width}, () => {
      const values = new Float64Array(packed.rows);
      let count = 0;
      for (let i = 0; i < packed.rows; i++) {
        count = (count + steps[place++]) | 0; // 32 bits that wrap around, as they were taken apart
        values[i] = count === MISSING ? NaN : count * step;
      }
      return values;
    });
  }
  return columns;
}

// Last sample at or before t.
function sampleAt(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t + 1e-9) low = middle;
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
