"""Proximal policy optimisation of stable-baselines3: ``python -m trocar.examples.ppo_baseline [STEPS] [SEED]``.

Needs ``trocar[envs]`` and ``stable-baselines3``, which Trocar does not depend on.
"""

# %% What is learned: the reward is way made towards the catheter, the mouth and the depth, and success
import sys

ENVIRONMENT = "trocar.envs:trocar/Insertion-v0"
"""With the module that registers it, as each process of stable-baselines3 must import that itself."""
RANGES = {"catheter.tip_position_m.1": (-2e-3, 2e-3), "catheter.tip_position_m.2": (-2e-3, 2e-3)}

# %% Two environments in processes, and ten episodes of what was learned
if __name__ == "__main__":
    try:
        from stable_baselines3 import PPO
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.evaluation import evaluate_policy
        from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize
    except ModuleNotFoundError as error:
        sys.exit(f"this example needs {error.name!r}: pip install stable-baselines3")

    steps, seed = (int(each) for each in (*sys.argv[1:], "200000", "0")[:2])
    made = make_vec_env(ENVIRONMENT, 2, seed, env_kwargs={"randomise": RANGES}, vec_env_cls=SubprocVecEnv)
    agents = VecNormalize(made)
    model = PPO("MlpPolicy", agents, seed=seed, n_steps=1024, batch_size=256, gamma=0.995, verbose=1, device="cpu")
    model.learn(steps)
    agents.training = agents.norm_reward = False
    print(evaluate_policy(model, agents, n_eval_episodes=10))
    agents.close()
