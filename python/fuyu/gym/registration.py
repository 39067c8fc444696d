"""Registers the environments with Gymnasium."""

import gymnasium

MODULE = "fuyu.gym.environments"


def register() -> None:
    """Makes `fuyu/Reach-v0`, `fuyu/Track-v0` and `fuyu/Capture-v0` known to `gymnasium.make` and `gymnasium.make_vec`."""
    for task in ["Reach", "Track", "Capture"]:
        name = f"fuyu/{task}-v0"
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{MODULE}:{task}Env",
                vector_entry_point=f"{MODULE}:{task}VectorEnv",
                # Episodes end by themselves, so that one environment and many do the same.
                max_episode_steps=None,
            )
