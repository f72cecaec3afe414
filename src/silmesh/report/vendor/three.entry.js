// What the page uses of three.js; `package.json` says how it becomes three.min.js.
export {
  AmbientLight, BackSide, BufferAttribute, BufferGeometry, Box3, Color, DirectionalLight, Group,
  LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  PerspectiveCamera, Scene, Spherical, Sphere, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
export { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
