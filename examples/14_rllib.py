"""Learning on many machines: Ray RLlib's env runners drive, its PPO learns. Needs the extra `ray`.

Here two runners run on this machine; on a cluster, call `ray.init(address="auto")` and use more runners.
Every machine keeps towns, models and machine code in its own cache, `CARLALOC_CACHE`.
"""

import os

try:
    import ray
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.tune.registry import register_env
except ImportError as error:
    raise SystemExit(f"{error}: pip install 'carlaloc[ray]'") from error

from carlaloc_env import CarlaLocEnv


def main(runners: int = 2, iterations: int = 50, actions: int = 2000) -> tuple[set[int], list[float]]:
    """Learn, and return the processes that drove and the mean return after each iteration."""
    ray.init(num_cpus=runners + 1, include_dashboard=False, ignore_reinit_error=True)
    register_env("town01", lambda config: CarlaLocEnv(map="Town01", rig="state", frame_skip=4, **config))
    config = (
        PPOConfig()
        .environment("town01")
        .env_runners(num_env_runners=runners, rollout_fragment_length="auto")
        .training(
            train_batch_size_per_learner=actions, minibatch_size=min(actions, 256), gamma=0.995, lr=1e-4
        )
    )
    ppo, returns = config.build_algo(), []
    for number in range(iterations):
        result = ppo.train()["env_runners"]
        returns.append(float(result.get("episode_return_mean", float("nan"))))
        print(f"{number}: {result['num_env_steps_sampled_lifetime']:.0f} actions, return {returns[-1]:.0f}")
    group = ppo.env_runner_group
    drove = set(group.foreach_env_runner(lambda runner: os.getpid(), local_env_runner=False))
    ppo.stop()
    ray.shutdown()
    return drove, returns


if __name__ == "__main__":
    main()
