"""Robots of fuyu in MuJoCo's format, for comparisons."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np

import fuyu


def mjcf(urdf: str, timestep: float) -> str:
    """The robot for MuJoCo, with a free base, RK4 and steps of `timestep` [s]; without visuals, contacts and gravity."""
    robot = ElementTree.fromstring(urdf)
    links = {link.get("name"): link for link in robot.findall("link")}
    joints = robot.findall("joint")
    children = {joint.find("child").get("link") for joint in joints}
    root = next(name for name in links if name not in children)

    def body(name: str, parent: ElementTree.Element, joint: ElementTree.Element | None) -> None:
        element = ElementTree.SubElement(parent, "body", name=name)
        if joint is None:
            ElementTree.SubElement(element, "freejoint")
        else:
            origin = joint.find("origin")
            if origin is not None:
                element.set("pos", origin.get("xyz", "0 0 0"))
                element.set("euler", origin.get("rpy", "0 0 0"))
            if joint.get("type") != "fixed":
                axis = joint.find("axis").get("xyz")
                ElementTree.SubElement(element, "joint", name=joint.get("name"), axis=axis)
        inertial = links[name].find("inertial")
        if inertial is not None:
            origin, inertia = inertial.find("origin"), inertial.find("inertia")
            values = [inertia.get(k, "0") for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
            ElementTree.SubElement(
                element,
                "inertial",
                pos="0 0 0" if origin is None else origin.get("xyz", "0 0 0"),
                mass=inertial.find("mass").get("value"),
                fullinertia=" ".join(values),
            )
        for child in joints:
            if child.find("parent").get("link") == name:
                body(child.find("child").get("link"), element, child)

    top = ElementTree.Element("mujoco")
    # URDF's angles are about fixed axes.
    ElementTree.SubElement(top, "compiler", angle="radian", eulerseq="XYZ")
    option = ElementTree.SubElement(top, "option", timestep=repr(timestep), integrator="RK4", gravity="0 0 0")
    ElementTree.SubElement(option, "flag", contact="disable", constraint="disable")
    body(root, ElementTree.SubElement(top, "worldbody"), None)
    actuator = ElementTree.SubElement(top, "actuator")
    for joint in joints:
        if joint.get("type") != "fixed":
            ElementTree.SubElement(actuator, "motor", joint=joint.get("name"))
    return ElementTree.tostring(top, encoding="unicode")


def check(urdf: str, xml: str) -> float:
    """Largest difference of the joint accelerations at random states, relative to the largest acceleration: the plants are the same."""
    robot, model = fuyu.Model.from_urdf(urdf), mujoco.MjModel.from_xml_string(xml)
    data, random, worst = mujoco.MjData(model), np.random.default_rng(1), 0.0
    for _ in range(20):
        q, qd, efforts = random.uniform(-2, 2, 6), random.normal(size=6), random.normal(size=6) * 20
        state = fuyu.State(robot, q, qd)
        data.qpos[:] = np.r_[0, 0, 0, 1, 0, 0, 0, q]
        data.qvel[:] = np.r_[np.zeros(6), qd]
        data.ctrl[:] = efforts
        mujoco.mj_forward(model, data)
        ours = robot.forward_dynamics(state, efforts)
        worst = max(worst, abs(ours - data.qacc[6:]).max() / abs(ours).max())
    return worst
