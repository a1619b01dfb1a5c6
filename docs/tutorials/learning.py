# %% [markdown]
# # Learning
#
# The observation `rig="state"` is a vector of named quantities, and a step takes about a millisecond. Here a
# driver of three numbers learns by trial: it keeps a change of its numbers when they earn more.

# %%
import gymnasium
import numpy as np

from carlaloc_env import state_names

env = gymnasium.make("CarlaLoc-Town10-v0", rig="state", traffic="empty", action="continuous")
names = {name: place for place, name in enumerate(state_names())}
print(env.observation_space.shape, env.action_space)
print([name for name in names if name.startswith("route_left")])

# %% [markdown]
# It steers towards the route 11 m ahead and against its distance from it. The pedal keeps to the limit.

# %%
LOOKS_AT = [names[name] for name in ("route_left_3", "lateral_offset", "speed_limit", "speed")]


def act(gains, seen):
    left, offset, limit, speed = seen[LOOKS_AT]
    steering, pedal = gains[0] * left - gains[1] * offset, gains[2] * (limit - speed)
    return np.clip([steering, pedal], -1.0, 1.0).astype(np.float32)


def episode(gains, steps=160):
    seen, info = env.reset(seed=3)
    earned, began_m = 0.0, info["route_s_m"]
    for _ in range(steps):
        seen, reward, terminated, truncated, info = env.step(act(gains, seen))
        earned += reward
        if terminated or truncated:
            break
    return earned, info["route_s_m"] - began_m


# %% [markdown]
# It begins with a foot that hardly touches the pedal, and tries forty changes, for eight seconds each.

# %%
rng = np.random.default_rng(0)
gains = np.array([0.2, 0.1, 0.2])
best, distance_m = episode(gains)
print(f"at first      reward {best:6.2f}   {distance_m:5.1f} m")
for trial in range(40):
    changed = gains * np.exp(0.5 * rng.normal(size=3))
    earned, distance_m = episode(changed)
    if earned > best:
        best, gains = earned, changed
        print(f"trial {trial:>2}      reward {best:6.2f}   {distance_m:5.1f} m   gains {gains.round(2)}")
env.close()

# %% [markdown]
# [Environments](../environments.md#learning) shows what networks reach among traffic.
