// What an object shows is made when it is opened, and its 3D view put away when it is closed.
"use strict";

silmesh.open = async function (details) {
  const object = details.dataset.object;
  const within = (selector) => details.querySelector(selector);
  const data = await silmesh.data(`data-${object}`);
  const places = details.dataset.places.split(" ").map(Number);
  await silmesh.library("uplot");
  const switches = [...details.querySelectorAll(".axes input")];
  silmesh.drawLosses(within(".losses"), data.runs, places, switches);
  silmesh.drawViews(within(".iou"), data.runs, places);
  silmesh.showGallery(within(".gallery"), within(".over select"), data);
  return data;
};

silmesh.openViewer = async function (details, data) {
  const box = details.querySelector(".viewer");
  if (!silmesh.hasWebGL()) {
    box.classList.add("still");
    return null;
  }
  await silmesh.library("three");
  return new silmesh.Viewer(box, details.dataset.object, data);
};

document.querySelectorAll("details.object").forEach((details) => {
  let opened = null;
  let viewer = null;
  async function open() {
    const data = await (opened ??= silmesh.open(details));
    await (viewer ??= silmesh.openViewer(details, data));
    details.dataset.ready = "yes";
  }
  async function close() {
    const closed = viewer;
    viewer = null;
    (await closed)?.dispose();
  }
  details.addEventListener("toggle", () => (details.open ? open() : close()));
  if (details.open) open();
});

// A link to an object opens it, also the one that the page was opened by.
silmesh.follow = function (hash) {
  const target = document.getElementById(decodeURIComponent(hash.slice(1)));
  const details = target?.closest("section").querySelector("details.object");
  if (details) details.open = true;
};
addEventListener("hashchange", () => silmesh.follow(location.hash));
document.querySelectorAll(".overview a").forEach((link) =>
  link.addEventListener("click", () => silmesh.follow(link.hash)));
silmesh.follow(location.hash);
silmesh.sortOverview(document.querySelector(".overview"), document.querySelector(".sort select"));
