"""CarlaLoc: a driving world, a SLAM sensor suite and a dataset factory.

Importing the package registers its Gymnasium environments and starts nothing; its public names
(docs/api.md) are loaded when they are asked for.
"""

from multiprocessing import current_process

from gymnasium.envs.registration import register, registry

from carlaloc_env.core.lazy_names import lazy_names

__version__ = "0.1.0"

TOWNS = ("Town01", "Town03", "Town04", "Town05", "Town06", "Town07", "Town10")
"""Towns that come with the package, each as `CarlaLoc-<town>-v0`."""
__getattr__, _names = lazy_names(__name__, __file__)
__all__ = [*_names, "TOWNS", "__version__"]


def register_environments() -> None:
    """Register the environments with Gymnasium, unless they are; importing the package calls it."""
    if "CarlaLoc-v0" in registry:
        return
    entry_point = "carlaloc_env.envs.carlaloc_env:CarlaLocEnv"
    register(id="CarlaLoc-v0", entry_point=entry_point)
    for town in (*TOWNS, "Town10HD"):
        register(id=f"CarlaLoc-{town}-v0", entry_point=entry_point, kwargs={"map": town})
    register(id="CarlaLoc-AnyTown-v0", entry_point="carlaloc_env.envs.any_town_env:AnyTownEnv")
    # By its name alone: drives are read by `recorder`, which is above this package.
    register(id="CarlaLoc-Replay-v0", entry_point="recorder.episode_env.replay_env:ReplayEnv")


register_environments()
# A new process (spawn, forkserver) knows no environment of its parent, but unpickles the parent's `_config`:
# the function in it imports this package there. Python without `_config` loses this alone.
getattr(current_process(), "_config", {})["carlaloc_env"] = register_environments
