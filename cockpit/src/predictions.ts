// Predictions of the target's attitude. The last ones are drawn together: where they differ, the prediction is uncertain.

import { BufferGeometry, Group, Line, LineBasicMaterial, Matrix4, Quaternion, Vector3 } from "three";
import type { Message } from "./connection";
import { dispose } from "./meshes";

/** How many predictions are drawn. */
const KEPT = 6;
/** Distance in front of the camera at which they are drawn, and length of the axes [m]. */
const DISTANCE = 5;
const LENGTH = 0.5;
const COLOURS = [0xdc3333, 0x33b34d, 0x4073f2];

export class Predictions {
  readonly group = new Group();
  frame?: string;

  constructor() {
    this.group.matrixAutoUpdate = false;
  }

  /** Adds a prediction (nav_msgs/Path of attitudes). */
  take(path: Message): void {
    this.frame = path.header.frame_id;
    const attitudes: Quaternion[] = path.poses.map(
      ({ pose: { orientation: o } }: Message) => new Quaternion(o.x, o.y, o.z, o.w),
    );
    const one = new Group();
    COLOURS.forEach((color, i) => {
      const axis = new Vector3().setComponent(i, LENGTH);
      const points = attitudes.map((q) => axis.clone().applyQuaternion(q).add(new Vector3(0, 0, DISTANCE)));
      one.add(new Line(new BufferGeometry().setFromPoints(points), new LineBasicMaterial({ color, transparent: true })));
    });
    this.group.add(one);
    while (this.group.children.length > KEPT) {
      dispose(this.group.children[0]);
      this.group.remove(this.group.children[0]);
    }
    this.group.children.forEach((old, i, all) => {
      const opacity = i === all.length - 1 ? 1 : 0.25;
      for (const line of old.children) ((line as Line).material as LineBasicMaterial).opacity = opacity;
    });
  }

  /** Places them in the camera's frame. */
  place(camera: Matrix4 | undefined): void {
    this.group.visible = camera !== undefined;
    if (camera) this.group.matrix.copy(camera);
  }

  clear(): void {
    dispose(this.group);
    this.group.clear();
    this.frame = undefined;
  }
}
