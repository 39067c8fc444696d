// The scene in the world's axes: robots and targets, markers, the trail of the tip, predictions.

import {
  AmbientLight, ArrowHelper, AxesHelper, BufferGeometry, Color, DirectionalLight, DoubleSide, Float32BufferAttribute, Group, Line,
  LineBasicMaterial, LineDashedMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, Object3D, Points, PointsMaterial, Scene,
  SphereGeometry, Vector3,
} from "three";
import type { URDFRobot } from "urdf-loader";
import type { Connection, Message } from "./connection";
import { Frames, matrix } from "./frames";
import { dispose, robot } from "./meshes";
import { Predictions } from "./predictions";

/** Points of the trail, about a minute. */
const TRAIL = 1200;
/** Shortest way between two points of the trail [m]. */
const TRAIL_STEP = 0.005;

/** What a topic of descriptions has brought. */
type Model = { model: URDFRobot; text: string; base: string };

export class World {
  readonly scene = new Scene();
  readonly frames = new Frames();
  readonly predictions = new Predictions();
  private readonly models = new Map<string, Model>();
  private readonly markers = new Map<string, { object: Object3D; frame: string; pose: Matrix4 }>();
  private readonly trail = new Line(new BufferGeometry(), new LineBasicMaterial({ color: 0xffd54a }));
  private trailPoints: number[] = [];
  private readonly ghost = new Mesh(
    new SphereGeometry(0.09, 16, 12),
    new MeshBasicMaterial({ color: 0x4df0ff, transparent: true, opacity: 0.75, depthTest: false }),
  );
  private readonly lead = new Line(
    new BufferGeometry().setAttribute("position", new Float32BufferAttribute(new Float32Array(6), 3)),
    new LineDashedMaterial({ color: 0x4df0ff, dashSize: 0.05, gapSize: 0.03, depthTest: false }),
  );
  private readonly tipAxes = new AxesHelper(0.4);
  private readonly baseAxes = new AxesHelper(1.5);
  /** Link of the tip; the deepest one if none is given. */
  tipLink?: string;

  constructor(private readonly connection: Connection) {
    this.scene.background = new Color(0x05070c);
    const sun = new DirectionalLight(0xffffff, 2.6);
    sun.position.set(5, -8, 10);
    this.scene.add(sun, new AmbientLight(0x8090a8, 1.1), stars(), this.trail, this.ghost, this.lead);
    this.scene.add(this.tipAxes, this.baseAxes, this.predictions.group);
    for (const object of [this.ghost, this.lead, this.trail]) object.frustumCulled = false;
    for (const object of [this.ghost, this.lead, this.tipAxes, this.baseAxes]) object.visible = false;
  }

  /** Subscribes to what is drawn. */
  subscribe(): void {
    const { connection } = this;
    const own = (topic: RegExp, take: (message: Message) => void) =>
      connection.on((c) => topic.test(c.topic) && !this.isOther(c.topic), take);
    own(/(^|\/)tf(_static)?$/, (message) => this.frames.take(message));
    connection.on((c) => c.topic.endsWith("/robot_description"), (m, topic) => this.describe(topic, m.data));
    connection.on((c) => c.topic.endsWith("/joint_states"), (m, topic) => this.move(topic, m));
    own(/\/markers$/, (message) => this.mark(message));
    own(/\/estimator\/prediction$/, (message) => this.predictions.take(message));
  }

  /** Namespaces of the robots, `/` or `/name/`. The first one is shown and operated. */
  private get namespaces(): string[] {
    const topics = [...this.connection.channels.values()].map((c) => c.topic);
    const described = topics.filter((t) => t.endsWith("/robot_description") && !t.includes("ground_truth"));
    const all = described.map((topic) => topic.replace(/robot_description$/, ""));
    return all.sort((a, b) => a.length - b.length || (a < b ? -1 : 1));
  }

  /** Whether a topic is that of another robot than the one that is shown: frames of both have the same names. */
  isOther(topic: string): boolean {
    const [own, ...others] = this.namespaces;
    return others.some((other) => other !== own && topic.startsWith(other));
  }

  /** Forgets what belongs to a connection that has ended. */
  reset(): void {
    for (const { model } of this.models.values()) this.remove(model);
    this.models.clear();
    for (const { object } of this.markers.values()) this.remove(object);
    this.markers.clear();
    this.frames.clear();
    this.predictions.clear();
    this.clearTrail();
  }

  clearTrail(): void {
    this.trailPoints = [];
    this.trail.geometry.setDrawRange(0, 0);
  }

  private remove(object: Object3D): void {
    this.scene.remove(object);
    dispose(object);
  }

  private describe(topic: string, text: string): void {
    const known = this.models.get(topic);
    if (known?.text === text) return;
    if (known) this.remove(known.model);
    const model = robot(text, this.connection);
    // The root link's own name is that of its frame.
    const base = model.urdfName || Object.keys(model.links)[0] || "";
    model.matrixAutoUpdate = false;
    this.models.set(topic, { model, text, base });
    this.scene.add(model);
  }

  private move(topic: string, message: Message): void {
    const of = this.models.get(topic.replace(/joint_states$/, "robot_description"));
    message.name.forEach((name: string, i: number) => of?.model.setJointValue(name, message.position[i]));
  }

  private mark(message: Message): void {
    for (const marker of message.markers) {
      const key = `${marker.ns} ${marker.id}`;
      const known = this.markers.get(key);
      if (known) this.remove(known.object);
      this.markers.delete(key);
      if (marker.action === 3) {
        for (const { object } of this.markers.values()) this.remove(object);
        this.markers.clear();
      }
      // Predictions are drawn with their spread, by this page.
      const object = marker.action === 0 && marker.ns !== "prediction" ? draw(marker) : undefined;
      if (!object) continue;
      object.matrixAutoUpdate = false;
      const pose = matrix(marker.pose.position, marker.pose.orientation);
      this.markers.set(key, { object, frame: marker.header.frame_id, pose });
      this.scene.add(object);
    }
  }

  private get chaser(): Model | undefined {
    return this.models.get(`${this.namespaces[0]}robot_description`);
  }

  get baseFrame(): string | undefined {
    return this.chaser?.base;
  }

  /** The tip's link. */
  get tip(): string | undefined {
    const model = this.chaser?.model;
    if (!model) return undefined;
    if (this.tipLink && model.links[this.tipLink]) return this.tipLink;
    let [deepest, depth] = ["", -1];
    for (const [name, link] of Object.entries(model.links)) {
      let n = 0;
      for (let o: Object3D | null = link; o && o !== model; o = o.parent) n += 1;
      if (n > depth) [deepest, depth] = [name, n];
    }
    return deepest;
  }

  /** Pose of a link of the robot in the world, as drawn. */
  linkPose(name: string): Matrix4 | undefined {
    return this.chaser?.model.links[name]?.matrixWorld.clone();
  }

  /** The link whose frame is that of the camera, if the description has one. */
  get cameraLink(): string | undefined {
    const links = Object.keys(this.chaser?.model.links ?? {});
    return links.find((name) => name.endsWith("camera_optical_frame")) ?? links.find((n) => n.includes("optical"));
  }

  /** Moves everything to where the last messages say. */
  update(): void {
    for (const [topic, { model, base }] of this.models) {
      const pose = this.isOther(topic) ? undefined : this.frames.pose(base);
      model.visible = pose !== undefined;
      if (pose) model.matrix.copy(pose);
    }
    for (const { object, frame, pose } of this.markers.values()) {
      const of = this.frames.pose(frame);
      object.visible = of !== undefined;
      if (of) object.matrix.multiplyMatrices(of, pose);
    }
    const camera = this.predictions.frame ? this.frames.pose(this.predictions.frame) : undefined;
    this.predictions.place(camera);
    this.scene.updateMatrixWorld(true);
    const tip = this.tip ? this.linkPose(this.tip) : undefined;
    const base = this.baseFrame ? this.frames.pose(this.baseFrame) : undefined;
    for (const [axes, pose] of [[this.tipAxes, tip], [this.baseAxes, base]] as const) {
      axes.visible = pose !== undefined;
      if (pose) pose.decompose(axes.position, axes.quaternion, axes.scale);
    }
    if (tip && base) this.extendTrail(new Vector3().setFromMatrixPosition(tip));
  }

  private extendTrail(tip: Vector3): void {
    const points = this.trailPoints;
    const last = points.length > 0 ? new Vector3().fromArray(points, points.length - 3) : undefined;
    if (last && last.distanceTo(tip) < TRAIL_STEP) return;
    points.push(tip.x, tip.y, tip.z);
    if (points.length > 3 * TRAIL) points.splice(0, points.length - 3 * TRAIL);
    let attribute = this.trail.geometry.getAttribute("position");
    if (!attribute) {
      attribute = new Float32BufferAttribute(new Float32Array(3 * TRAIL), 3);
      this.trail.geometry.setAttribute("position", attribute);
    }
    (attribute.array as Float32Array).set(points);
    attribute.needsUpdate = true;
    this.trail.geometry.setDrawRange(0, points.length / 3);
  }

  /** Shows where the tip will be, according to what has been commanded; nothing without a displacement (world axes) [m]. */
  showCommanded(displacement: Vector3 | undefined): void {
    const tip = this.tip ? this.linkPose(this.tip) : undefined;
    const visible = displacement !== undefined && tip !== undefined;
    this.ghost.visible = this.lead.visible = visible;
    if (!visible) return;
    const from = new Vector3().setFromMatrixPosition(tip);
    this.ghost.position.copy(from).add(displacement);
    const ends = this.lead.geometry.getAttribute("position");
    ends.setXYZ(0, from.x, from.y, from.z);
    ends.setXYZ(1, this.ghost.position.x, this.ghost.position.y, this.ghost.position.z);
    ends.needsUpdate = true;
    this.lead.computeLineDistances();
  }
}

function stars(): Points {
  const positions: number[] = [];
  // A fixed sky: the same generator every time.
  let seed = 7;
  const next = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  for (let i = 0; i < 400; i++) {
    const z = 2 * next() - 1;
    const angle = 2 * Math.PI * next();
    const r = Math.sqrt(1 - z * z);
    positions.push(900 * r * Math.cos(angle), 900 * r * Math.sin(angle), 900 * z);
  }
  const geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(positions, 3));
  return new Points(geometry, new PointsMaterial({ color: 0xaab4c4, size: 1.5, sizeAttenuation: false }));
}

function vector(p: Message): Vector3 {
  return new Vector3(p.x, p.y, p.z);
}

/** The types of visualization_msgs/Marker that the node views publishes. */
function draw(marker: Message): Object3D | undefined {
  const points: Vector3[] = marker.points.map(vector);
  const { r, g, b, a } = marker.color;
  const colour = new Color(r, g, b);
  const geometry = new BufferGeometry().setFromPoints(points);
  if (marker.colors.length === points.length && points.length > 0) {
    const colours = marker.colors.flatMap((c: Message) => [c.r, c.g, c.b]);
    geometry.setAttribute("color", new Float32BufferAttribute(colours, 3));
  }
  const vertexColors = geometry.hasAttribute("color");
  const line = () => new LineBasicMaterial({ color: vertexColors ? 0xffffff : colour, vertexColors });
  switch (marker.type) {
    case 0: {
      if (points.length < 2) return undefined;
      const along = points[1].clone().sub(points[0]);
      const length = along.length();
      return length < 1e-6 ? undefined : new Group().add(new ArrowHelper(along.normalize(), points[0], length, colour, marker.scale.z || 0.1, marker.scale.y || 0.05));
    }
    case 4:
      return new Line(geometry, line());
    case 5:
      return new LineSegments(geometry, line());
    case 11: {
      geometry.computeVertexNormals();
      return new Mesh(geometry, new MeshBasicMaterial({ color: colour, side: DoubleSide, transparent: a < 1, opacity: a }));
    }
    default:
      return undefined;
  }
}

/** Roll, pitch and yaw of a pose [rad], about fixed axes x, y, z. */
export function rollPitchYaw(pose: Matrix4): [number, number, number] {
  const e = pose.elements;
  return [Math.atan2(e[6], e[10]), Math.asin(Math.max(-1, Math.min(1, -e[2]))), Math.atan2(e[1], e[0])];
}
