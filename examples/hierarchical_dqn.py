"""The paper's two-step hierarchical DQN in one file, in plain JAX and Optax.

Zhang, Yurtsever and Redmill (arXiv 2501.14992). Numbers in parentheses are the paper's equations;
"ours" marks what the paper does not have. Two slow cars box the ego in. To get out it must first
brake and lose reward. A flat DQN does not learn that. Here a high level sets goals (lane, speed):
step 1: the high level learns, while a rule-based planner drives to its goals;
step 2: the high level is frozen, and a low level learns in the planner's place.

The road, its traffic and the planner are the library's, and the settings those of preset ``quick``.
`tests/training/test_first_updates.py` shows that the first updates equal the library's.

    python examples/hierarchical_dqn.py --seed 0
"""

from collections import namedtuple
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import Array

from lanewise import TaskFunctions
from lanewise.controllers import planner
from lanewise.controllers.settings import PlannerSettings
from lanewise.driving import percept
from lanewise.driving.settings import DrivingSettings
from lanewise.envs import functional
from lanewise.scenario.trap import start_key
from lanewise.world.state import World

DRIVING, PLANNER = DrivingSettings(), PlannerSettings()
# Goals.
SPEED_STEP, SPEED_BOUNDS = 1.0, (5.0, 16.0)  # delta; bounds of target speeds (ours), m/s
TOLERANCES, SCALES = (0.3, 0.3), (4.0, 2.0)  # D_delta, V_delta; errors that read as 1; m and m/s
TIME_LIMIT, RENEWAL = 6, 2  # decisions until the next goal at the latest: step 1 (ours), step 2
TRACKING_WEIGHT = 1.0  # of the distance from the goal in the low level's reward (ours)
# Double DQN, the same for both levels. Linear schedules: (first, last).
CHOICES, HIDDEN, DISCOUNT, BATCH, CAPACITY = 9, (512, 512), 0.8, 64, 50_000
LEARNING_RATES, EPSILONS, EPSILON_DECISIONS = (1e-3, 1e-4), (0.5, 0.02), 32_000
TARGET_RATE = 0.01  # share of the online network that the target network takes in at each update
WARM_UP, DECISIONS_PER_UPDATE = 1_000, 8  # decisions of all worlds together
# Training and tests.
CHUNK, VALIDATION_INTERVAL = 50, 2  # decisions of each world in one compiled call; in chunks
VALIDATION_EPISODES, WINDOW, TEST_EPISODES = 200, 5, 300  # the window is of validations (ours)


# The task. Functions are written for one world; jax.vmap makes many of it. Vehicle 0 is the ego.


def observe(settings: Any, world: World) -> Array:
    """The state, [26]: [presence, x, y, v_x, v_y] of the ego, its lane offset, 4 other vehicles."""
    cars, width = world.vehicles, jnp.sum(world.road.width)
    along, across = cars.speed * jnp.cos(cars.heading), cars.speed * jnp.sin(cars.heading)
    rows = jnp.stack([jnp.ones_like(cars.x), cars.x, cars.y, along, across], axis=-1)
    dx, dy = cars.x - cars.x[0], cars.y - cars.y[0]
    visible = cars.present & (dx > -10.0) & (jnp.sqrt(dx**2 + dy**2) < 200.0)
    distance = jnp.where(visible.at[0].set(False), jnp.abs(dx), jnp.inf)
    nearest = jnp.argsort(distance)[:4]
    others = rows[nearest] - rows[0].at[0].set(0.0)  # Relative to the ego, but for the presence.
    others = jnp.where(jnp.isfinite(distance[nearest])[:, None], others, 0.0)
    ego = rows[0] / jnp.stack([1.0, 200.0, width, 15.0, 5.0])
    others = others / jnp.stack([1.0, 60.0, width, 5.0, 5.0])
    _, offset = nearest_lane(world)
    return jnp.clip(jnp.concatenate([ego, offset[None] / 2.0, others.reshape(-1)]), -2.0, 2.0)


def reward(settings: Any, world: World, steering: Array, accident: Array) -> Array:
    """The external reward of a decision, from the world after it."""
    v, (_, offset) = world.vehicles.speed[0], nearest_lane(world)
    too_fast = jnp.exp(-jnp.square(jnp.maximum(v, 15.0) - 15.0))
    zones = [too_fast, 8 / 25 * v - 19 / 5, 2 / 75 * v - 2 / 15]
    r_v = jnp.select([v > 15.0, v > 12.5, v > 5.0], zones, 0.0)  # (3)
    r_y = jnp.exp(-1.5 * jnp.square(offset))  # (4)
    r_theta = -jnp.abs(jnp.sin(steering))  # (5)
    driving = (1.5 * r_v + 0.05 * r_theta + 0.05 * r_y) / (1.5 + 0.05 + 0.05)
    return jnp.where(accident, -10.0, driving)  # (6)


def nearest_lane(world: World) -> tuple[Array, Array]:
    """(The ego's lane, its distance from that lane's centre in m, positive to the right)."""
    offsets = world.vehicles.y[0] - world.road.centre
    lane = jnp.argmin(jnp.abs(offsets)).astype(jnp.int32)
    return lane, offsets[lane]


# The nine actions are {-1, 0, 1} m/s^2 (1) times {-pi/50, 0, pi/50} rad (2).
make_trap = partial(functional.make, task=TaskFunctions(observe=observe, reward=reward))


# Goals: target lane and speed, the decisions since it was set, and whether the next one is due.

Goal = namedtuple("Goal", "lane speed age due")


def set_goal(goal: Goal, choice: Array, world: World) -> Goal:
    """Where a goal is due, move it by {left, keep, right} times {-delta, keep, +delta}."""
    lane = jnp.clip(goal.lane + choice // 3 - 1, 0, len(world.road.centre) - 1)
    speed = jnp.clip(goal.speed + (choice % 3 - 1) * SPEED_STEP, *SPEED_BOUNDS)
    return select(goal.due, Goal(lane, speed, jnp.int32(0), jnp.bool_(False)), goal)


def goal_errors(goal: Goal, world: World) -> Array:
    """Delta d in m (11) and Delta v in m/s (12), [2]."""
    cars = world.vehicles
    along = cars.speed[0] * jnp.cos(cars.heading[0])
    return jnp.stack([world.road.centre[goal.lane] - cars.y[0], goal.speed - along])


def goal_critic(goal: Goal, world: World, lifetime: int) -> Goal:
    """After a decision: the next goal is due if this one is reached (13, 14) or old enough."""
    reached = jnp.all(jnp.abs(goal_errors(goal, world)) < jnp.array(TOLERANCES))
    age = goal.age + 1
    return goal._replace(age=age, due=reached | (age >= lifetime))


def low_level_features(observation: Array, goal: Goal, world: World) -> Array:
    """What the low level observes, [28]: the state, and how far its goal is."""
    scaled = goal_errors(goal, world) / jnp.array(SCALES)
    return jnp.concatenate([observation, jnp.clip(scaled, -2.0, 2.0)])


def select(condition: Array, new: Any, old: Any) -> Any:
    """The new tree if the condition holds, else the old one."""
    return jax.tree.map(lambda n, o: jnp.where(condition, n, o), new, old)


# Double DQN (van Hasselt et al. 2016). The discount is 0 after an accident; moments are Adam's.

Transition = namedtuple("Transition", "features choice reward discount next_features")
Replay = namedtuple("Replay", "rows written")
Learner = namedtuple("Learner", "online target moments")


def init_network(key: Array, inputs: int) -> list[tuple[Array, Array]]:
    """Weights and biases by layer, uniform within 1 / sqrt(inputs of the layer), as in PyTorch."""
    layers, sizes = [], (inputs, *HIDDEN, CHOICES)
    for layer_key, n, m in zip(jax.random.split(key, 3), sizes[:-1], sizes[1:], strict=True):
        keys, bound = jax.random.split(layer_key), n**-0.5
        weights = jax.random.uniform(keys[0], (n, m), minval=-bound, maxval=bound)
        layers.append((weights, jax.random.uniform(keys[1], (m,), minval=-bound, maxval=bound)))
    return layers


def q_values(network: Any, features: Array) -> Array:
    """Q(s, a) of every choice."""
    *hidden, (last_weights, last_biases) = network
    for weights, biases in hidden:
        features = jax.nn.relu(features @ weights + biases)
    return features @ last_weights + last_biases


def epsilon_greedy(network: Any, features: Array, epsilon: Array, key: Array) -> Array:
    """A random choice with probability epsilon, else the one with the largest Q-value."""
    explore_key, choice_key = jax.random.split(key)
    explores = jax.random.uniform(explore_key) < epsilon
    random = jax.random.randint(choice_key, (), 0, CHOICES)
    return jnp.where(explores, random, jnp.argmax(q_values(network, features)))


def add(replay: Replay, batch: Transition, complete: Array) -> Replay:
    """Write the complete ones of a batch, the oldest transitions being overwritten first."""
    count = jnp.cumsum(complete)
    # The others get a row past the end, and are dropped.
    row = jnp.where(complete, (replay.written + count - 1) % CAPACITY, CAPACITY)
    rows = jax.tree.map(lambda old, new: old.at[row].set(new, mode="drop"), replay.rows, batch)
    return Replay(rows, replay.written + count[-1])


def td_loss(online: Any, target: Any, batch: Transition) -> Array:
    """Mean squared TD error (10); the online network chooses, the target network values."""
    each = jnp.arange(BATCH)
    best = jnp.argmax(q_values(online, batch.next_features), axis=-1)
    value = q_values(target, batch.next_features)[each, best]
    y = jax.lax.stop_gradient(batch.reward + batch.discount * value)
    return jnp.mean(jnp.square(y - q_values(online, batch.features)[each, batch.choice]))


def update(optimiser: Any, replay: Replay, key: Array, number: Array, learner: Learner) -> Learner:
    """One step of Adam on a random batch; the target network follows as a moving average."""
    filled, key = jnp.clip(replay.written, 1, CAPACITY), jax.random.fold_in(key, number)
    drawn = jax.random.randint(key, (BATCH,), 0, filled)
    batch = jax.tree.map(lambda rows: rows[drawn], replay.rows)
    gradient = jax.grad(td_loss)(learner.online, learner.target, batch)
    change, moments = optimiser.update(gradient, learner.moments)
    online = optax.apply_updates(learner.online, change)
    target = jax.tree.map(lambda t, o: t + TARGET_RATE * (o - t), learner.target, online)
    return Learner(online, target, moments)


# The two steps: one decision in one world, and the transition that it leaves for the replay memory.
# Pending is the high level's transition while its goal lasts.

Drive = namedtuple("Drive", "state observation goal pending")


def begin(high: Any, state: functional.State, observation: Array) -> Drive:
    """A fresh episode; in step 2 the high level has set a goal when the low level first acts."""
    world, zero = state.episode.world, jnp.float32(0.0)
    speed = jnp.clip(world.vehicles.speed[0], *SPEED_BOUNDS)
    goal = Goal(nearest_lane(world)[0], speed, jnp.int32(0), jnp.bool_(True))
    if high is not None:
        goal = set_goal(goal, jnp.argmax(q_values(high, observation)), world)
    nothing = Transition(observation, jnp.int32(0), zero, zero, observation)
    return Drive(state, observation, goal, nothing)


def step_1(trap: Any, _: None, high: Any, epsilon: Any, drive: Drive, key: Array) -> Any:
    """The high level sets a goal if one is due, the planner acts: one transition for each goal."""
    world, observation = drive.state.episode.world, drive.observation
    choice = epsilon_greedy(high, observation, epsilon, key)
    chosen = drive.pending._replace(features=observation, choice=choice, reward=0.0)
    pending = select(drive.goal.due, chosen, drive.pending)
    goal = set_goal(drive.goal, choice, world)
    ego = percept.perceive(DRIVING.observation, world)

    state, shown = functional.step(trap, drive.state, planner.act(PLANNER, DRIVING, goal, ego))
    goal = goal_critic(goal, state.episode.world, TIME_LIMIT)
    pending = pending._replace(
        # The rewards inside a goal are summed, and gamma counts once for it. The other reading is
        # gamma^k for a goal of k decisions; then the far end of the escape is worth little.
        reward=pending.reward + shown.reward,
        discount=jnp.where(shown.terminated, 0.0, DISCOUNT),  # Not at a time-out.
        next_features=shown.observation,
    )
    complete = goal.due | shown.terminated | shown.truncated
    return Drive(state, shown.observation, goal, pending), shown, pending, complete


def step_2(trap: Any, high: Any, low: Any, epsilon: Any, drive: Drive, key: Array) -> Any:
    """The low level acts, then the high level sets a goal if due: a transition each decision."""
    features = low_level_features(drive.observation, drive.goal, drive.state.episode.world)
    action = epsilon_greedy(low, features, epsilon, key)

    state, shown = functional.step(trap, drive.state, action)
    world = state.episode.world
    distance = jnp.sum(jnp.abs(goal_errors(drive.goal, world)) / jnp.array(SCALES))
    reward = shown.reward - jnp.where(shown.terminated, 0.0, TRACKING_WEIGHT * distance)
    discount = jnp.where(shown.terminated, 0.0, DISCOUNT)
    goal = goal_critic(drive.goal, world, RENEWAL)
    goal = set_goal(goal, jnp.argmax(q_values(high, shown.observation)), world)
    next_features = low_level_features(shown.observation, goal, world)
    transition = Transition(features, action, reward, discount, next_features)
    return Drive(state, shown.observation, goal, drive.pending), shown, transition, True


# Training: features, one decision, and the trap with training episodes of 125 s and of 30 s.
Step = namedtuple("Step", "name inputs decide trap")
STEP_1 = Step("step 1", 26, step_1, make_trap(duration=125.0))
STEP_2 = Step("step 2", 28, step_2, make_trap(duration=30.0))


def start(step: Step, optimiser: Any, high: Any, key: Array, worlds: int) -> Any:
    """(learner, replay, drives) before the first decision."""
    online = init_network(jax.random.fold_in(key, 0), step.inputs)
    features, zeros = jnp.zeros((CAPACITY, step.inputs)), jnp.zeros(CAPACITY)
    rows = Transition(features, zeros.astype(jnp.int32), zeros, zeros, features)
    keys = jax.random.split(jax.random.fold_in(key, 1), worlds)
    state, shown = jax.vmap(partial(functional.reset, step.trap))(keys)
    drives = jax.vmap(partial(begin, high))(state, shown.observation)
    return Learner(online, online, optimiser.init(online)), Replay(rows, jnp.int32(0)), drives


@partial(jax.jit, static_argnames=("step", "optimiser"))
def advance(step: Step, optimiser: Any, high: Any, key: Array, done: int, training: Any) -> Any:
    """The next CHUNK iterations: one decision in every world, then the updates that are due."""
    worlds = training[-1].observation.shape[0]

    def iterate(training: Any, iteration: Array) -> tuple[Any, None]:
        learner, replay, drives = training
        drive_key, update_key = jax.random.split(jax.random.fold_in(key, iteration + 2))
        keys = jax.vmap(jax.random.split)(jax.random.split(drive_key, worlds))
        epsilon = optax.linear_schedule(*EPSILONS, EPSILON_DECISIONS)(iteration * worlds)
        decide = partial(step.decide, step.trap, high, learner.online, epsilon)
        drives, shown, transitions, complete = jax.vmap(decide)(drives, keys[:, 0])
        replay = add(replay, transitions, complete)
        fresh = functional.restarted(step.trap, drives.state, shown, keys[:, 1])
        fresh = jax.vmap(partial(begin, high))(*fresh)
        drives = jax.vmap(select)(shown.terminated | shown.truncated, fresh, drives)

        due = ((iteration + 1) * worlds > WARM_UP) * (worlds // DECISIONS_PER_UPDATE)
        learn = partial(update, optimiser, replay, update_key)
        learner = jax.lax.fori_loop(0, due, learn, learner)
        return (learner, replay, drives), None

    return jax.lax.scan(iterate, training, done + jnp.arange(CHUNK))[0]


@partial(jax.jit, static_argnames=("step", "split", "episodes"))
def evaluate(step: Step, split: str, episodes: int, seed: int, high: Any, network: Any) -> Any:
    """What is counted in greedy episodes of 25 s, [episodes]; network is the one step trains."""
    trap = make_trap(split=split)

    def episode(index: Array) -> Any:
        state, shown = functional.reset(trap, start_key(seed, split, index))

        def decide(_: Array, drive: Drive) -> Drive:
            after, *_ = step.decide(trap, high, network, 0.0, drive, jax.random.key(0))
            return select(drive.state.episode.outcome.over, drive, after)

        drive = begin(high, state, shown.observation)
        return jax.lax.fori_loop(0, trap.duration, decide, drive).state.episode.stats

    return jax.vmap(episode)(jnp.arange(episodes))


def report(what: str, stats: Any) -> float:
    """Print the figures of a test; return the score by which networks are chosen."""
    counted = (stats.success, stats.outcome.terminated, stats.timestep_reward)
    success, accidents, reward = (float(each.mean()) for each in counted)
    print(f"{what}: {success:.1%} success, {accidents:.1%} accidents, reward {reward:.2f}")
    return success - accidents + reward / 50


def train(step: Step, high: Any, key: Array, worlds: int, decisions: int) -> Any:
    """The network that a step hands on, chosen by validation on starts like those of training."""
    schedule = optax.linear_schedule(*LEARNING_RATES, decisions // DECISIONS_PER_UPDATE)
    optimiser = optax.adam(schedule)
    training = start(step, optimiser, high, key, worlds)
    recent, best, last = [], (-jnp.inf, None), -(-decisions // (CHUNK * worlds))
    for chunk in range(1, last + 1):
        training = advance(step, optimiser, high, key, (chunk - 1) * CHUNK, training)
        if chunk % VALIDATION_INTERVAL and chunk < last:
            continue
        network = training[0].online
        stats = evaluate(step, "validation", VALIDATION_EPISODES, 0, high, network)
        score = report(f"{step.name}, {chunk * CHUNK * worlds:,} decisions", stats)
        recent = [*recent, (score, network)][-WINDOW:]
        if len(recent) == WINDOW or chunk == last:  # A lucky validation is no median of five.
            median = sorted(recent, key=lambda each: each[0])[(len(recent) - 1) // 2]
            best = max(best, median, key=lambda each: each[0])
    return best[1]


def main(seed: int = 0, worlds: int = 32, decisions: tuple[int, int] = (120_000, 240_000)) -> Any:
    """Train for so many decisions in each step, those of all worlds together, then test."""
    if worlds % DECISIONS_PER_UPDATE:
        raise SystemExit(f"--worlds must be a multiple of {DECISIONS_PER_UPDATE}, got {worlds}")
    keys = [jax.random.fold_in(jax.random.key(seed), 1000 + index) for index in range(2)]
    high = train(STEP_1, None, keys[0], worlds, decisions[0])
    low = train(STEP_2, high, keys[1], worlds, decisions[1])
    report("test", evaluate(STEP_2, "test", TEST_EPISODES, seed, high, low))
    return high, low


if __name__ == "__main__":
    import tyro

    tyro.cli(main)
