"""A base with two panels as chains of rigid segments in MuJoCo: coordinates, seconds a step, attitude at the end.

Arguments: segments, step [s], steps, rounds, then length, width, mass per area, EI, GJ, and the base's angular velocity.
"""

import sys
import time

import mujoco


def piece(length, width, areal_mass):
    """Mass, centre of mass and moments of inertia of a piece of a panel, as MJCF."""
    mass = areal_mass * width * length
    along, across = mass * length**2 / 12, mass * width**2 / 12
    return (
        f'<inertial pos="{length / 2!r} 0 0" mass="{mass!r}" '
        f'diaginertia="{across!r} {along!r} {along + across!r}"/>'
    )


def panel(n, length, width, areal_mass, EI, GJ):
    """Bodies of a chain, one in the other: springs in bending and torsion at the middle of each of n equal parts."""
    h = length / n
    xml = ""
    for i in reversed(range(n)):
        at = h / 2 if i == 0 else h
        own = h / 2 if i + 1 == n else h
        xml = (
            f'<body pos="{at!r} 0 0">{piece(own, width, areal_mass)}'
            f'<joint axis="0 -1 0" stiffness="{EI / h!r}"/><joint axis="1 0 0" stiffness="{GJ / h!r}"/>{xml}</body>'
        )
    # The first half part is fixed to the base.
    return f"<body>{piece(h / 2, width, areal_mass)}{xml}</body>"


def main():
    n, dt, steps, rounds = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    numbers = [float(x) for x in sys.argv[5:]]
    strip, spin = numbers[:5], numbers[5:]
    chain = panel(n, *strip)
    plus = chain.replace("<body>", '<body pos="1.2 0 0">', 1)
    minus = chain.replace("<body>", '<body pos="-1.2 0 0" quat="0 0 0 1">', 1)
    xml = (
        f'<mujoco><compiler inertiafromgeom="false" balanceinertia="false" boundmass="0" boundinertia="0"/>'
        f'<option gravity="0 0 0" timestep="{dt!r}" integrator="RK4">'
        '<flag contact="disable" constraint="disable"/></option>'
        '<worldbody><body><freejoint/><inertial pos="0 0 0" mass="1000" diaginertia="1200 800 1500"/>'
        f"{plus}{minus}</body></worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    best = float("inf")
    for _ in range(rounds):
        mujoco.mj_resetData(model, data)
        data.qvel[3:6] = spin
        start = time.perf_counter()
        mujoco.mj_step(model, data, nstep=steps)
        best = min(best, time.perf_counter() - start)
    print(model.nv - 6, best / steps, *data.qpos[3:7])


main()
