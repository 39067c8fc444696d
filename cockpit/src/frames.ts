// Frames of tf: the latest transform of each, and poses in the world's axes.

import { Matrix4, Quaternion, Vector3 } from "three";
import type { Message } from "./connection";

/** The inertial frame, in which the scene is drawn. */
export const WORLD = "world";
/** Longest chain of frames: a loop of parents ends there. */
const DEEPEST = 100;

export function matrix(translation: Message, rotation: Message, into = new Matrix4()): Matrix4 {
  return into.compose(
    new Vector3(translation.x, translation.y, translation.z),
    new Quaternion(rotation.x, rotation.y, rotation.z, rotation.w).normalize(),
    new Vector3(1, 1, 1),
  );
}

export class Frames {
  private readonly parents = new Map<string, { parent: string; pose: Matrix4 }>();

  take(message: Message): void {
    for (const { header, child_frame_id, transform } of message.transforms) {
      const known = this.parents.get(child_frame_id);
      const pose = matrix(transform.translation, transform.rotation, known?.pose);
      this.parents.set(child_frame_id, { parent: header.frame_id, pose });
    }
  }

  /** Pose of a frame in the world: of the root of its tree, if the tree does not contain the world. */
  pose(frame: string): Matrix4 | undefined {
    if (frame === WORLD) return new Matrix4();
    if (!this.parents.has(frame)) return undefined;
    const pose = new Matrix4();
    let name = frame;
    for (let depth = 0; depth < DEEPEST; depth++) {
      const found = this.parents.get(name);
      if (!found) return pose;
      pose.premultiply(found.pose);
      name = found.parent;
    }
    return undefined;
  }

  clear(): void {
    this.parents.clear();
  }
}
