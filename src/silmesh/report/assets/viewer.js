// Two panes of meshes in 3D that turn together, by three.js. All stands at unit size, upright along
// y, with the first camera towards z, whatever the world that the cameras came in.
"use strict";

const SHOWN = { first: "initial mesh", fitted: "fitted mesh", standing: "by what it stands on" };

silmesh.hasWebGL = () => !!document.createElement("canvas").getContext("webgl2");

silmesh.Viewer = class {
  // box holds the controls; object is its number, data what is packed of it
  constructor(box, object, data) {
    Object.assign(this, { box, object, data, loaded: {}, panes: [], ended: new AbortController() });
    this.canvas = box.querySelector("canvas");
    this.status = box.querySelector(".status");
    this.selects = [...box.querySelectorAll("select")];
    this.switches = Object.fromEntries(
      [...box.querySelectorAll("input")].map((input) => [input.name, input]));
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setScissorTest(true);
    this.camera = new THREE.PerspectiveCamera(30, 1, 0.05, 60);
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.enablePan = false;
    this.listen();
    this.fill().then(() => this.reset());
  }

  listen() {
    const on = (target, what, act) =>
      target.addEventListener(what, act, { signal: this.ended.signal });
    for (const name of ["colours", "wireframe"])
      on(this.switches[name], "change", () => this.fill());
    for (const chooser of [...this.selects, this.switches.cameras])
      on(chooser, "change", () => this.fill().then(() => this.frame()));
    on(this.box.querySelector("button"), "click", () => this.reset());
    on(this.canvas, "keydown", (event) => this.press(event));
    on(matchMedia("(prefers-color-scheme: dark)"), "change", () => this.draw());
    this.controls.addEventListener("change", () => this.draw());
    this.observer = new ResizeObserver(() => this.draw());
    this.observer.observe(this.canvas);
  }

  dispose() {
    this.ended.abort();
    this.observer.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.replaceWith(this.canvas.cloneNode()); // one whose context is not lost
  }

  // Look from the first camera's side and a little from above.
  reset() {
    this.camera.position.setFromSphericalCoords(1, (70 * Math.PI) / 180, (25 * Math.PI) / 180);
    this.controls.target.set(0, 0, 0);
    this.frame();
  }

  // Go as far away, in the same direction, that all that is shown is seen.
  frame() {
    const all = new THREE.Box3();
    for (const pane of this.panes) all.expandByObject(pane.scene);
    const middle = all.getCenter(new THREE.Vector3());
    const radius = Math.max(...this.panes.map((pane) => this.reach(pane.scene, middle)));
    const way = this.camera.position.clone().sub(this.controls.target).normalize();
    this.far = (1.05 * radius) / Math.sin(Math.PI / 12);
    Object.assign(this.controls, { minDistance: 0.2 * this.far, maxDistance: 5 * this.far });
    this.controls.target.copy(middle);
    this.place(way.multiplyScalar(this.far));
  }

  // How far what a scene shows reaches from a point.
  reach(scene, point) {
    const corner = new THREE.Vector3();
    let most = 0;
    scene.traverse((node) => {
      const places = node.geometry?.attributes.position;
      for (let i = 0; i < (places?.count ?? 0); i++) {
        corner.fromBufferAttribute(places, i).applyMatrix4(node.matrixWorld);
        most = Math.max(most, corner.distanceTo(point));
      }
    });
    return most;
  }

  // Put the camera there, seen from what it looks at.
  place(offset) {
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.draw();
  }

  press(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const zooms = { "+": 1 / 1.1, "=": 1 / 1.1, "-": 1.1 };
    const turn = turns[event.key] ?? [0, 0];
    const zoom = zooms[event.key] ?? 1;
    if (!(event.key in turns) && !(event.key in zooms)) return;
    event.preventDefault();
    const place = this.polar();
    place.theta += turn[0] * 0.15;
    place.phi = Math.min(Math.max(place.phi + turn[1] * 0.15, 0.05), 3.09);
    place.radius = Math.min(Math.max(place.radius * zoom, 0.2 * this.far), 5 * this.far);
    this.place(new THREE.Vector3().setFromSpherical(place));
  }

  polar() {
    const offset = this.camera.position.clone().sub(this.controls.target);
    return new THREE.Spherical().setFromVector3(offset);
  }

  // What a choice, "<run> <fitted, first, standing or truth>", shows: a scene, made once for each look.
  async pane(choice) {
    const [run, what] = choice.split(" ");
    const shown = this.data.runs[run];
    const geometry = await this.load(what === "truth" ? `truth-${this.object}` : `mesh-${this.object}-${run}-${what}`);
    const scene = new THREE.Scene();
    const upright = new THREE.Group();
    upright.matrixAutoUpdate = false;
    upright.matrix.copy(this.stand(shown));
    const placed = new THREE.Group();
    placed.matrixAutoUpdate = false;
    placed.matrix.copy(geometry.matrix);
    if (what === "truth") placed.matrix.premultiply(new THREE.Matrix4().fromArray(shown.placed));
    placed.add(...this.looks(geometry));
    upright.add(placed);
    if (this.switches.cameras.checked) upright.add(this.frusta(shown));
    scene.add(upright, new THREE.AmbientLight(0xffffff, 1.1));
    const lights = [[-0.45, 0.9, 0.6, 2.1], [0.8, -0.1, 0.6, 0.8]].map(([x, y, z, strength]) => {
      const light = new THREE.DirectionalLight(0xffffff, strength);
      light.userData.from = new THREE.Vector3(x, y, z);
      scene.add(light);
      return light;
    });
    const faces = geometry.shape.index.count / 3;
    const name = what === "truth" ? "the truth" : `${shown.variant}, ${SHOWN[what]}`;
    return { scene, lights, says: `${name}: ${faces.toLocaleString("en")} triangles` };
  }

  load(id) {
    return (this.loaded[id] ??= (async () => {
      const gltf = await new THREE.GLTFLoader().parseAsync(await silmesh.bytes(id), "");
      gltf.scene.updateMatrixWorld(true);
      let mesh = null;
      gltf.scene.traverse((node) => { if (node.isMesh) mesh = node; });
      if (!mesh.geometry.attributes.normal) mesh.geometry.computeVertexNormals();
      return { shape: mesh.geometry, matrix: mesh.matrixWorld, texture: mesh.material.map };
    })());
  }

  // In its texture, else in the colours of its vertices, if colours are wanted and there are any.
  looks({ shape, texture }) {
    const wanted = this.switches.colours.checked;
    const coloured = wanted && !texture && !!shape.attributes.color;
    const outside = new THREE.MeshLambertMaterial({
      color: coloured || (wanted && texture) ? 0xffffff : 0xd6d1c7,
      map: wanted ? texture : null, vertexColors: coloured,
      polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    });
    const inside = new THREE.MeshLambertMaterial({ color: 0xb85c54, side: THREE.BackSide });
    const meshes = [new THREE.Mesh(shape, outside), new THREE.Mesh(shape, inside)];
    if (this.switches.wireframe.checked) {
      const lines = new THREE.MeshBasicMaterial({ color: 0x24292f, wireframe: true, transparent: true, opacity: 0.45 });
      meshes.push(new THREE.Mesh(shape, lines));
    }
    return meshes;
  }

  // From the run's world to the one that is shown: up along y, the first camera towards z.
  stand(run) {
    const up = new THREE.Vector3(...run.up);
    const back = new THREE.Vector3(...run.ahead).negate();
    const aside = new THREE.Vector3().crossVectors(up, back);
    return new THREE.Matrix4().makeBasis(aside, up, back).transpose();
  }

  frusta(run) {
    const { apexes, corners, views } = run.cameras;
    const gallery = this.data.galleries[run.gallery];
    const outliers = new Set(gallery.views.filter((view) => view.doubt).map((view) => view.name));
    const [first, last] = [new THREE.Color(0x2b8ad6), new THREE.Color(0xe66e00)];
    const points = [];
    const colours = [];
    apexes.forEach((apex, i) => {
      const mixed = first.clone().lerp(last, i / Math.max(apexes.length - 1, 1));
      const colour = outliers.has(views[i]) ? new THREE.Color(0xc82828) : mixed;
      corners[i].forEach((corner, k) => {
        for (const point of [apex, corner, corner, corners[i][(k + 1) % 4]]) {
          points.push(...point);
          colours.push(colour.r, colour.g, colour.b);
        }
      });
    });
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    shape.setAttribute("color", new THREE.BufferAttribute(new Float32Array(colours), 3));
    return new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ vertexColors: true }));
  }

  async fill() {
    const choices = this.selects.map((select) => select.value).filter(Boolean);
    const panes = await Promise.all(choices.map((choice) => this.pane(choice)));
    this.panes = panes;
    this.status.textContent = panes.map((pane) => pane.says).join(" | ");
    this.draw();
    this.box.dataset.showing = choices.join(" | "); // for those who wait for it
  }

  draw() {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!width || !this.panes.length) return;
    if (`${width} ${height}` !== this.size) this.renderer.setSize(width, height, false);
    this.size = `${width} ${height}`;
    const wide = width / this.panes.length;
    this.camera.aspect = wide / height;
    this.camera.fov = this.camera.aspect < 1 ? (2 * Math.atan(Math.tan(Math.PI / 12) / this.camera.aspect) * 180) / Math.PI : 30;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    this.renderer.setClearColor(new THREE.Color(silmesh.colour("--stage")));
    this.panes.forEach((pane, i) => {
      for (const light of pane.lights)
        light.position.copy(light.userData.from).applyQuaternion(this.camera.quaternion);
      this.renderer.setViewport(i * wide, 0, wide, height);
      this.renderer.setScissor(i * wide, 0, wide, height);
      this.renderer.render(pane.scene, this.camera);
    });
    const place = this.polar();
    Object.assign(this.canvas.dataset, { turn: place.theta.toFixed(3), far: place.radius.toFixed(3) });
  }
};
