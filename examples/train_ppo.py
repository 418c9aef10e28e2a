"""Train a policy with PPO, without the reflex, and compare it with a careless one.

It needs PyTorch and gymnasium: make install-train, or pip install 'grasp-controller[gym,train]'.
The algorithm: Schulman et al., Proximal Policy Optimization Algorithms (2017).
"""

import argparse

import gymnasium
import numpy as np
import torch
from torch import nn

LIFT = "grasp.gym:grasp/Lift-v0"
ENVS, LENGTH = 8, 40  # episodes at once, and decisions between two updates
REPEAT = 10  # control steps of 10 ms for each decision
GAMMA, LAMBDA, CLIP, EPOCHS, BATCH, RATE, REWARD_SCALE = 0.98, 0.95, 0.2, 10, 80, 1e-3, 0.03
GRIP = np.array([55, 55, 55])  # finger positions of a weak grip of the can


def features(obs):
    """The observation as 26 numbers of about -1 to 1."""
    parts = (obs["taxels"] / 200, obs["fingers"] / 100 - 0.5, obs["force_n"] / 10, 4 * obs["arm"])
    return torch.as_tensor(np.concatenate([part.ravel() for part in parts]), dtype=torch.float32)


def layers(outputs):
    hidden = nn.Linear(26, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()
    return nn.Sequential(*hidden, nn.Linear(64, outputs))


class Agent(nn.Module):
    """A normal distribution of actions, and the value of an observation."""

    def __init__(self):
        super().__init__()
        self.mean, self.value = layers(4), layers(1)
        with torch.no_grad():
            self.mean[-1].weight *= 0.01
            self.mean[-1].bias[:3] = 0.5  # at first it closes the fingers
        self.log_std = nn.Parameter(torch.full((4,), -0.3))

    def actions(self, x):
        return torch.distributions.Normal(self.mean(x), self.log_std.exp())


def decide(env, action):
    """One decision: the same action for some control steps."""
    total = 0.0
    for _ in range(REPEAT):
        obs, reward, terminated, truncated, _ = env.step(action)
        total += reward
        if terminated or truncated:
            break
    return features(obs), total, terminated, truncated


@torch.no_grad()
def rollout(agent, envs, states):
    """Decisions of all episodes: observations, actions, log probabilities, advantages, returns."""
    steps = []
    for _ in range(LENGTH):
        spread = agent.actions(x := torch.stack(states))
        action = spread.sample()
        reward, alive = torch.zeros(ENVS), torch.ones(ENVS)
        for i, env in enumerate(envs):
            states[i], total, terminated, truncated = decide(env, action[i].clamp(-1, 1).numpy())
            reward[i] = REWARD_SCALE * total
            if truncated and not terminated:  # the time is over, the object is still held
                reward[i] += GAMMA * agent.value(states[i])[0]
            if terminated or truncated:
                alive[i], states[i] = 0.0, features(env.reset()[0])
        log, value = spread.log_prob(action).sum(-1), agent.value(x)[:, 0]
        steps.append((x, action, log, value, reward, alive))
    xs, acts, logs, values, rewards, alives = map(torch.stack, zip(*steps, strict=True))
    gains, advantage = torch.zeros_like(rewards), torch.zeros(ENVS)
    following = agent.value(torch.stack(states))[:, 0]
    for t in reversed(range(LENGTH)):
        surprise = rewards[t] + GAMMA * alives[t] * following - values[t]
        gains[t] = advantage = surprise + GAMMA * LAMBDA * alives[t] * advantage
        following = values[t]
    print(f": reward of a decision {rewards.mean() / REWARD_SCALE:.2f}", flush=True)
    return [part.flatten(0, 1) for part in (xs, acts, logs, gains, gains + values)]


def update(agent, optimizer, xs, acts, logs, gains, returns):
    gains = (gains - gains.mean()) / (gains.std() + 1e-8)
    for _ in range(EPOCHS):
        for part in torch.randperm(len(xs)).split(BATCH):
            spread = agent.actions(xs[part])
            ratio = (spread.log_prob(acts[part]).sum(-1) - logs[part]).exp()
            gain, clipped = gains[part], ratio.clamp(1 - CLIP, 1 + CLIP)
            miss = (agent.value(xs[part])[:, 0] - returns[part]).pow(2).mean()
            loss = 0.5 * miss - torch.min(ratio * gain, clipped * gain).mean()
            loss = loss - 0.001 * spread.entropy().sum(-1).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()


def train(decisions):
    torch.manual_seed(0)
    torch.set_num_threads(1)
    options = {"object": "can", "reflex": False, "reward": "dense", "max_episode_steps": 400}
    envs, agent = [gymnasium.make(LIFT, **options) for _ in range(ENVS)], Agent()
    optimizer = torch.optim.Adam(agent.parameters(), RATE)
    states = [features(env.reset(seed=1000 + i)[0]) for i, env in enumerate(envs)]
    for done in range(0, decisions, ENVS * LENGTH):
        print(f"{done} decisions", end="")
        update(agent, optimizer, *rollout(agent, envs, states))
    return agent


def evaluate(name, reflex, policy):
    """Lifts with seeds that the training has not used."""
    env, ends = gymnasium.make(LIFT, object="can", reflex=reflex), []
    for seed in range(args.episodes):
        (obs, info), step, over = env.reset(seed=seed), 0, False
        while not over:
            obs, _, terminated, truncated, info = env.step(policy(obs, step))
            step, over = step + 1, terminated or truncated
        ends.append((info["held"], info["is_success"], 1e3 * info["slip_m"], info["peak_force_n"]))
    held, success, slip_mm, force_n = np.array(ends).T
    print(f"{name}: held {held.mean():.0%}, also within the force limit {success.mean():.0%},")
    print(f"   slip {np.median(slip_mm):.1f} mm (median), force at most {force_n.max():.1f} N")


def careless(obs, step):
    """Close to the weak grip, and lift after two seconds, whatever happens."""
    return np.array([*np.clip((GRIP - obs["fingers"]) / 5, -1, 1), step > 200], np.float32)


parser = argparse.ArgumentParser()
parser.add_argument("--decisions", type=int, default=14_400, help="of the training")
parser.add_argument("--episodes", type=int, default=20, help="of each comparison")
args = parser.parse_args()
agent = train(args.decisions)


def trained(obs, step):
    if step % REPEAT == 0:
        trained.action = agent.mean(features(obs)).detach().clamp(-1, 1).numpy()
    return trained.action


evaluate("PPO", False, trained)
evaluate("PPO with the reflex", True, trained)
evaluate("careless policy", False, careless)
evaluate("careless policy with the reflex", True, careless)
