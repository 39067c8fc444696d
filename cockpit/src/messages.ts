// Definitions of the messages that the page publishes, and their parts.

const RULE = "=".repeat(80);
const TIME = `${RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n`;
const HEADER = `${RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n${TIME}`;

export const JOY = { type: "sensor_msgs/msg/Joy", text: `std_msgs/Header header\nfloat32[] axes\nint32[] buttons\n${HEADER}` };

export const POSE_STAMPED = {
  type: "geometry_msgs/msg/PoseStamped",
  text:
    `std_msgs/Header header\ngeometry_msgs/Pose pose\n${HEADER}` +
    `${RULE}\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n` +
    `${RULE}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n` +
    `${RULE}\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n`,
};

/** A time of the page's clock [ms] as a stamp. */
export function stamp(milliseconds: number): { sec: number; nsec: number; nanosec: number } {
  const sec = Math.floor(milliseconds / 1000);
  const nsec = Math.min(999_999_999, Math.round((milliseconds - 1000 * sec) * 1e6));
  return { sec, nsec, nanosec: nsec };
}

/** A stamp of a message [s]. */
export function seconds(time: { sec: number; nsec?: number; nanosec?: number }): number {
  return time.sec + (time.nsec ?? time.nanosec ?? 0) * 1e-9;
}
