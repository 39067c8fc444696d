// The views: the stereo pair of the cameras on the moving base, and the overview; side by side, as anaglyph, or in VR.

import {
  LinearFilter, Matrix4, Mesh, OrthographicCamera, PerspectiveCamera, PlaneGeometry, Quaternion, Scene, ShaderMaterial, Texture,
  Vector2, Vector3, Vector4, WebGLRenderTarget, WebGLRenderer, Group,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { World } from "./scene";

export type Layout = "split" | "stereo" | "anaglyph" | "overview";
export type Eye = "left" | "right";

/** From the axes of an optical frame (z forward, y down) to those of a camera in three.js (z backward, y up). */
const OPTICAL = new Quaternion(1, 0, 0, 0);

/** A pinhole camera, as sensor_msgs/CameraInfo states it. */
export type Pinhole = { fy: number; width: number; height: number };

/** Shows two pictures in red and cyan, or one, by their brightness. */
const COMPOSITE = `
  uniform sampler2D left; uniform sampler2D right; varying vec2 at;
  void main() {
    vec3 l = texture2D(left, at).rgb; vec3 r = texture2D(right, at).rgb;
    gl_FragColor = vec4(dot(l, vec3(0.299, 0.587, 0.114)), r.g, r.b, 1.0);
    #include <colorspace_fragment>
  }`;
const PICTURE = `
  uniform sampler2D left; varying vec2 at;
  void main() {
    gl_FragColor = vec4(texture2D(left, at).rgb, 1.0);
    #include <colorspace_fragment>
  }`;
const VERTEX = `varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }`;

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly overview = new PerspectiveCamera(50, 1, 0.05, 3000);
  readonly eyes: Record<Eye, PerspectiveCamera> = {
    left: new PerspectiveCamera(60, 1, 0.05, 3000),
    right: new PerspectiveCamera(60, 1, 0.05, 3000),
  };
  layout: Layout = "split";
  eyeDistance = 0.12;
  pinhole?: Pinhole;
  /** Pictures of real cameras; what they are labelled with. */
  readonly pictures: Partial<Record<Eye, Texture>> = {};
  /** Frames drawn since the start. */
  frames = 0;
  private readonly controls: OrbitControls;
  private readonly rig = new Group();
  private readonly vrCamera = new PerspectiveCamera(60, 1, 0.05, 3000);
  private readonly targets: Record<Eye, WebGLRenderTarget>;
  private readonly flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
  private readonly composite: Mesh<PlaneGeometry, ShaderMaterial>;
  private readonly picture: Mesh<PlaneGeometry, ShaderMaterial>;
  private placed = false;

  constructor(canvas: HTMLCanvasElement, surface: HTMLElement, private readonly world: World) {
    this.renderer = new WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true, powerPreference: "low-power" });
    this.renderer.autoClear = false;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 1.5));
    this.overview.up.set(0, 0, 1);
    this.overview.position.set(9, -6, 6);
    this.controls = new OrbitControls(this.overview, surface);
    this.controls.enableDamping = false;
    this.targets = { left: target(), right: target() };
    this.composite = plane(COMPOSITE);
    this.picture = plane(PICTURE);
    this.rig.add(this.vrCamera);
    world.scene.add(this.rig);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    this.resize();
  }

  private resize(): void {
    const parent = this.renderer.domElement.parentElement;
    if (parent && !this.renderer.xr.isPresenting) this.renderer.setSize(parent.clientWidth, parent.clientHeight, false);
  }

  /** Whether the eyes are those of a robot: its description has the frame of a camera. */
  get hasCamera(): boolean {
    return this.world.cameraLink !== undefined;
  }

  private placeEyes(aspect: number): void {
    const link = this.world.cameraLink;
    const pose = link ? this.world.linkPose(link) : undefined;
    const fov = this.pinhole ? (2 * Math.atan(this.pinhole.height / (2 * this.pinhole.fy)) * 180) / Math.PI : 60;
    const [position, rotation, scale] = [new Vector3(), new Quaternion(), new Vector3()];
    (pose ?? new Matrix4()).decompose(position, rotation, scale);
    const sideways = new Vector3(1, 0, 0).applyQuaternion(rotation);
    for (const [eye, side] of [["left", -0.5], ["right", 0.5]] as const) {
      const camera = this.eyes[eye];
      camera.position.copy(position).addScaledVector(sideways, side * this.eyeDistance);
      camera.quaternion.copy(rotation).multiply(OPTICAL);
      camera.fov = fov;
      camera.aspect = aspect;
      camera.updateProjectionMatrix();
      camera.updateMatrixWorld();
    }
    this.rig.position.copy(position);
    this.rig.quaternion.copy(rotation).multiply(OPTICAL);
  }

  /** Turns the overview to the robot once, when it is there. */
  private placeOverview(): void {
    const base = this.world.baseFrame ? this.world.frames.pose(this.world.baseFrame) : undefined;
    const tip = this.world.tip ? this.world.linkPose(this.world.tip) : undefined;
    if (this.placed || !base || !tip) return;
    this.placed = true;
    const centre = new Vector3().setFromMatrixPosition(base).add(new Vector3().setFromMatrixPosition(tip)).multiplyScalar(0.5);
    this.controls.target.copy(centre);
    this.overview.position.copy(centre).add(new Vector3(8, -5, 5));
    this.controls.update();
  }

  /** Draws a frame. */
  draw(): void {
    this.frames += 1;
    this.world.update();
    this.placeOverview();
    const { renderer } = this;
    if (renderer.xr.isPresenting) {
      this.placeEyes(1);
      this.rig.updateMatrixWorld(true);
      renderer.clear();
      renderer.render(this.world.scene, this.vrCamera);
      return;
    }
    const size = renderer.getSize(new Vector2());
    renderer.setScissorTest(true);
    for (const [name, box] of Object.entries(this.boxes(size))) {
      renderer.setViewport(box);
      renderer.setScissor(box);
      renderer.clear();
      const aspect = box.z / Math.max(1, box.w);
      this.placeEyes(aspect);
      if (name === "overview") {
        this.overview.aspect = aspect;
        this.overview.updateProjectionMatrix();
        renderer.render(this.world.scene, this.overview);
      } else if (name === "anaglyph") this.anaglyph(box);
      else this.eye(name as Eye);
    }
    renderer.setScissorTest(false);
  }

  /** Where each view is drawn, from the lower left corner. */
  boxes(size: Vector2): Record<string, Vector4> {
    const { x: w, y: h } = size;
    switch (this.layout) {
      case "overview":
        return { overview: new Vector4(0, 0, w, h) };
      case "anaglyph":
        return { anaglyph: new Vector4(0, 0, w, h) };
      case "stereo":
        return { left: new Vector4(0, 0, w / 2, h), right: new Vector4(w / 2, 0, w / 2, h) };
      default:
        return {
          left: new Vector4(0, h / 2, w / 2, h / 2),
          right: new Vector4(w / 2, h / 2, w / 2, h / 2),
          overview: new Vector4(0, 0, w, h / 2),
        };
    }
  }

  private eye(eye: Eye): void {
    const picture = this.pictures[eye];
    if (picture) {
      this.picture.material.uniforms.left.value = picture;
      this.renderer.render(this.picture, this.flat);
    } else this.renderer.render(this.world.scene, this.eyes[eye]);
  }

  private anaglyph(box: Vector4): void {
    const ratio = this.renderer.getPixelRatio();
    for (const eye of ["left", "right"] as const) {
      this.targets[eye].setSize(Math.round(box.z * ratio), Math.round(box.w * ratio));
      this.renderer.setRenderTarget(this.targets[eye]);
      this.renderer.clear();
      this.eye(eye);
      this.composite.material.uniforms[eye].value = this.targets[eye].texture;
    }
    this.renderer.setRenderTarget(null);
    this.renderer.render(this.composite, this.flat);
  }

  /** The pixel of a point in the world (from the upper left corner of the canvas) in a view; `undefined` behind the camera. */
  project(point: Vector3, view: Eye | "overview"): { x: number; y: number } | undefined {
    const size = this.renderer.getSize(new Vector2());
    const box = this.boxes(size)[view];
    if (!box) return undefined;
    const camera = view === "overview" ? this.overview : this.eyes[view];
    const p = point.clone().project(camera);
    if (p.z > 1) return undefined;
    return { x: box.x + ((p.x + 1) / 2) * box.z, y: size.y - (box.y + ((p.y + 1) / 2) * box.w) };
  }
}

function target(): WebGLRenderTarget {
  return new WebGLRenderTarget(1, 1, { minFilter: LinearFilter, magFilter: LinearFilter });
}

function plane(fragmentShader: string): Mesh<PlaneGeometry, ShaderMaterial> {
  const uniforms = { left: { value: null }, right: { value: null } };
  const material = new ShaderMaterial({ vertexShader: VERTEX, fragmentShader, uniforms, depthTest: false, depthWrite: false });
  const mesh = new Mesh(new PlaneGeometry(2, 2), material);
  mesh.frustumCulled = false;
  new Scene().add(mesh);
  return mesh;
}
