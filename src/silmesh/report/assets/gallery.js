// The photographs with the contours of the silhouette and of the fitted mesh over them.
"use strict";

silmesh.FATES = {
  good: "good",
  kept: "outlier, kept",
  repaired: "outlier, repaired",
  dropped: "outlier, dropped",
  lost: "no camera, left out",
};

silmesh.showGallery = function (box, select, data) {
  function contour(name, d) {
    const under = silmesh.make("path", { class: "under", d });
    return d ? [under, silmesh.make("path", { class: name, d })] : [];
  }

  function show(view, run) {
    const [x, y, width] = view.crop;
    const fate = view.doubt ? view.fate : "good";
    const iou = run.iou[view.name];
    const said = [iou === undefined ? "" : `IoU ${iou.toFixed(3)}`];
    if (run.held.includes(view.name)) said.push("held out of the fit");
    const says = `${view.name}: ${silmesh.FATES[fate]}. ${view.doubt}`;
    function draw(label, ...contours) {
      return silmesh.make(
        "svg",
        { viewBox: `${x} ${y} ${width} ${width}`, role: "img", "aria-label": label },
        silmesh.make("image", { x, y, width, height: width, href: `data:image/webp;base64,${view.photo}` }),
        ...contours,
      );
    }
    const picture = draw(
      says, ...contour("silhouette", view.silhouette), ...contour("mesh", run.outlines[view.name] ?? ""),
    );
    // What was found stands beside what it was repaired to; of an empty silhouette, the photograph.
    const found = fate === "repaired" ? [draw(`${view.name}: as found`, ...contour("before", view.before))] : [];
    const pictures = silmesh.make("div", { class: "pictures" }, ...found, picture);
    const caption = silmesh.make(
      "figcaption", {},
      silmesh.make("b", {}, view.name),
      silmesh.make("span", { class: `fate ${fate}` }, silmesh.FATES[fate]),
      silmesh.make("span", {}, said.filter(Boolean).join(", ")),
      silmesh.make("span", { class: "doubt" }, view.doubt),
    );
    return silmesh.make("figure", { class: `view ${fate}` }, pictures, caption);
  }

  function fill() {
    const run = data.runs[select.value];
    const gallery = data.galleries[run.gallery];
    box.replaceChildren(...gallery.views.map((view) => show(view, run)));
  }
  select.addEventListener("change", fill);
  fill();
};
