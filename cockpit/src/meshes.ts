// Meshes of robot descriptions, fetched from the server by the names in the description.

import { Group, LoadingManager, Mesh, MeshStandardMaterial, type Material, type Object3D } from "three";
import { ColladaLoader } from "three/examples/jsm/loaders/ColladaLoader.js";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import { OBJLoader } from "three/examples/jsm/loaders/OBJLoader.js";
import { STLLoader } from "three/examples/jsm/loaders/STLLoader.js";
import URDFLoader, { type URDFRobot } from "urdf-loader";
import type { Connection } from "./connection";

function buffer(data: DataView): ArrayBuffer {
  return data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength) as ArrayBuffer;
}

async function mesh(name: string, data: DataView, material: Material): Promise<Object3D> {
  const bytes = buffer(data);
  switch (name.split(".").pop()?.toLowerCase()) {
    case "stl":
      return new Mesh(new STLLoader().parse(bytes), material);
    case "obj": {
      const group = new OBJLoader().parse(new TextDecoder().decode(bytes));
      group.traverse((part) => {
        if (part instanceof Mesh) part.material = material;
      });
      return group;
    }
    case "dae":
      return new ColladaLoader().parse(new TextDecoder().decode(bytes), "")?.scene ?? new Group();
    case "glb":
    case "gltf":
      return (await new GLTFLoader().parseAsync(bytes, "")).scene;
    default:
      throw new Error(`${name}: expected .stl, .obj, .dae, .gltf or .glb`);
  }
}

/** The model of a robot description; its meshes appear when they have arrived. */
export function robot(urdf: string, connection: Connection): URDFRobot {
  const loader = new URDFLoader(new LoadingManager());
  // Names stay as the description has them: the server knows them by these.
  loader.packages = (name: string) => `package://${name}`;
  loader.loadMeshCb = (name, _manager, material, done) => {
    connection
      .fetchAsset(name)
      .then((data) => mesh(name, data, material))
      .then((found) => done(found))
      .catch((error: Error) => {
        connection.onNotice(`mesh ${name}: ${error.message}`);
        done(new Group(), error);
      });
  };
  const model = loader.parse(urdf);
  // The simulation decides where joints are, also beyond limits.
  for (const joint of Object.values(model.joints)) joint.ignoreLimits = true;
  model.traverse((part) => {
    // The loader's material shines; surfaces of spacecraft are drawn matt.
    if (part instanceof Mesh && "color" in part.material) {
      part.material = new MeshStandardMaterial({ color: part.material.color, roughness: 0.8, side: 2 });
    }
  });
  return model;
}

/** Frees what a model holds on the graphics processor. */
export function dispose(object: Object3D): void {
  object.traverse((part) => {
    const { geometry, material } = part as Partial<Mesh>;
    geometry?.dispose();
    for (const one of Array.isArray(material) ? material : [material]) one?.dispose();
  });
}
