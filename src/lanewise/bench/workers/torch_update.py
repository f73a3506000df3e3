"""The same double DQN update in PyTorch, as plain as such code is written. Needs only PyTorch.

Network, batch, precision, optimiser, double target and moving average are those of our update, and
its transitions too are drawn from a filled replay of the same size.
"""

import os
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import torch
from torch import nn


def prepare(
    inputs: int,
    outputs: int,
    hidden: list[int],
    batch: int,
    capacity: int,
    learning_rate: float,
    discount: float,
    target_rate: float,
    seconds: float,
    compiled: bool = False,
    seed: int = 0,
) -> Callable[[], dict[str, Any]]:
    """Fills a replay and warms up; the result updates for ``seconds``."""
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    torch.manual_seed(seed)
    online, target = network(inputs, hidden, outputs), network(inputs, hidden, outputs)
    target.load_state_dict(online.state_dict())
    adam = torch.optim.Adam(online.parameters(), lr=learning_rate, foreach=True)
    features, following = torch.randn(capacity, inputs), torch.randn(capacity, inputs)
    action, reward = torch.randint(outputs, (capacity, 1)), torch.randn(capacity)
    pairs = list(target.parameters()), list(online.parameters())

    def loss_of(index: Any) -> Any:
        with torch.no_grad():
            best = online(following[index]).argmax(1, keepdim=True)
            value = target(following[index]).gather(1, best).squeeze(1)
        q = online(features[index]).gather(1, action[index]).squeeze(1)
        return nn.functional.mse_loss(q, reward[index] + discount * value)

    forward = torch.compile(loss_of) if compiled else loss_of

    def update() -> None:
        loss = forward(torch.randint(capacity, (batch,)))
        adam.zero_grad()
        loss.backward()
        adam.step()
        with torch.no_grad():
            torch._foreach_lerp_(pairs[0], pairs[1], target_rate)

    began = time.perf_counter()
    for _ in range(50):
        update()
    warming = time.perf_counter() - began

    def measure() -> dict[str, Any]:
        done, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds:
            update()
            done += 1
        return {
            "updates": done,
            "seconds": time.perf_counter() - began,
            "compile_seconds": warming,
        }

    return measure


def network(inputs: int, hidden: list[int], outputs: int) -> Any:
    """A multilayer perceptron with ReLU between its layers."""
    widths = [inputs, *hidden, outputs]
    layers: list[Any] = []
    for wide, narrow in pairwise(widths):
        layers += [nn.Linear(wide, narrow), nn.ReLU()]
    return nn.Sequential(*layers[:-1])
