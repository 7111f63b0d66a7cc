"""Proximal policy optimisation of stable-baselines3: ``python -m trocar.examples.ppo_baseline [STEPS] [SEED]``.

Needs ``trocar[envs]`` and ``stable-baselines3``, which Trocar does not depend on.
"""

# %% Two environments in processes; what is asked of the agent is the wrapper's reward: way made, success, errors
import sys

if __name__ == "__main__":
    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.evaluation import evaluate_policy
        from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize
    except ModuleNotFoundError as error:
        sys.exit(f"this example needs {error.name!r}: pip install stable-baselines3")
    import trocar.envs  # noqa: F401 (registers the environment)

    steps, seed = (int(each) for each in (*sys.argv[1:], "200000", "0")[:2])
    ranges = {"catheter.tip_position_m.1": (-2e-3, 2e-3), "catheter.tip_position_m.2": (-2e-3, 2e-3)}
    made = make_vec_env("trocar/Insertion-v0", 2, seed, env_kwargs={"randomise": ranges}, vec_env_cls=SubprocVecEnv)
    agents = VecNormalize(made)
    model = PPO("MlpPolicy", agents, seed=seed, n_steps=1024, batch_size=256, gamma=0.995, verbose=1, device="cpu")
    model.learn(steps)
    agents.training = agents.norm_reward = False
    print(evaluate_policy(model, agents, n_eval_episodes=10))
    agents.close()
