// What the pages use of three.js; esbuild leaves out the rest.

export {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry, DirectionalLight, Group,
  HemisphereLight, Mesh, MeshLambertMaterial, NotEqualStencilFunc, PCFShadowMap, PerspectiveCamera, Quaternion, Raycaster,
  ReplaceStencilOp, Scene, SphereGeometry, SRGBColorSpace, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
export { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
