// What the page carries packed, gzip in base64 (packing.py), and the libraries among it.
"use strict";

const silmesh = {};

// What is packed stands behind the scripts, and the last of it is read a while after the first.
silmesh.whole = new Promise((resolve) => addEventListener("DOMContentLoaded", resolve));

silmesh.bytes = async function (id) {
  await silmesh.whole;
  const letters = atob(document.getElementById(id).textContent);
  const packed = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
};

silmesh.text = async (id) => new TextDecoder().decode(await silmesh.bytes(id));

silmesh.data = async (id) => JSON.parse(await silmesh.text(id));

// Run a library once, when the first object is opened: a script of its own, so it can be global.
silmesh.library = (function () {
  const running = {};
  async function run(name) {
    const script = document.createElement("script");
    script.textContent = await silmesh.text(`library-${name}`);
    document.head.append(script);
  }
  return (name) => (running[name] ??= run(name));
})();

silmesh.colour = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(name).trim();

silmesh.make = function (tag, attributes = {}, ...children) {
  const svg = ["svg", "path", "image", "g"].includes(tag);
  const element = svg
    ? document.createElementNS("http://www.w3.org/2000/svg", tag)
    : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
};
