"""One-way delay of joint states at 1 kHz in another stack. Usage: speed_peer.py rclpy|cyclone send|take COUNT"""

import os
import sys
import time

stack, role, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
NAMES = [f"joint{i}" for i in range(1, 7)]


def report(delays):
    delays.sort()
    at = lambda part: delays[int((len(delays) - 1) * part)] * 1e-3
    print(f"took {len(delays)} p50 {at(0.5):.1f} p99 {at(0.99):.1f}", flush=True)
    os._exit(0)


def every_millisecond(publish):
    """Twice as long as asked for: the receiver counts from when it is there."""
    due = time.monotonic()
    for number in range(4 * count + 30_000):
        publish(time.time_ns())
        due += 0.001
        time.sleep(max(0.0, due - time.monotonic()))


if stack == "rclpy":
    import rclpy
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState

    rclpy.init()
    node = rclpy.create_node(role)
    if role == "send":
        publisher = node.create_publisher(JointState, "speed", qos_profile_sensor_data)
        state = JointState(name=NAMES, position=[0.1] * 6, velocity=[0.2] * 6, effort=[0.3] * 6)
        while publisher.get_subscription_count() == 0:
            time.sleep(0.05)

        def publish(now):
            state.header.stamp.sec, state.header.stamp.nanosec = divmod(now, 1_000_000_000)
            publisher.publish(state)

        every_millisecond(publish)
    else:
        delays = []

        def take(state):
            now = time.time_ns()
            delays.append(now - state.header.stamp.sec * 1_000_000_000 - state.header.stamp.nanosec)
            if len(delays) == count:
                report(delays)

        node.create_subscription(JointState, "speed", take, qos_profile_sensor_data)
        rclpy.spin(node)
else:
    os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain>
    <General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
    <Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
    </Domain></CycloneDDS>"""
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import make_idl_struct, types
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    Time = make_idl_struct("Time_", "builtin_interfaces::msg::dds_::Time_", {"sec": types.int32, "nanosec": types.uint32})
    Header = make_idl_struct("Header_", "std_msgs::msg::dds_::Header_", {"stamp": Time, "frame_id": str})
    numbers = types.sequence[types.float64]
    JointState = make_idl_struct(
        "JointState_",
        "sensor_msgs::msg::dds_::JointState_",
        {"header": Header, "name": types.sequence[str], "position": numbers, "velocity": numbers, "effort": numbers},
    )
    qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(5))
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    topic = Topic(participant, "rt/speed", JointState, qos=qos)
    if role == "send":
        writer = DataWriter(participant, topic, qos=qos)
        state = JointState(Time, NAMES, [0.1] * 6, [0.2] * 6, [0.3] * 6)
        while writer.get_publication_matched_status().current_count == 0:
            time.sleep(0.05)

        def publish(now):
            state.header = Header(Time(*divmod(now, 1_000_000_000)), "")
            writer.write(state)

        every_millisecond(publish)
    else:
        reader, delays = DataReader(participant, topic, qos=qos), []
        for state in reader.take_iter(timeout=duration(seconds=60)):
            now = time.time_ns()
            delays.append(now - state.header.stamp.sec * 1_000_000_000 - state.header.stamp.nanosec)
            if len(delays) == count:
                report(delays)
