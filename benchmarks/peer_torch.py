"""Our update in PyTorch, as plain as such code is written. Needs only PyTorch.

Network, batch, precision, optimiser, double target and moving average are those of our update. Its
transitions too are drawn from a filled replay of the same size.
"""

import os
import time
from itertools import pairwise

import timing
import torch
from torch import nn


def _begin(seed):
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    torch.manual_seed(seed)


def matrix_product(rows, inner, columns, seconds, seed=0):
    """GFLOP/s of the matrix product in the shape of the update's largest one."""
    _begin(seed)
    left, right = torch.randn(rows, inner), torch.randn(inner, columns) / inner**0.5
    out = torch.empty(rows, columns)

    def call():
        for _ in range(100):
            torch.mm(left, right, out=out)

    call()
    work = 2.0 * rows * inner * columns * 100
    return lambda: timing.result(timing.calls_per_second(call, seconds) * work / 1e9, "GFLOP/s")


def update(
    inputs, hidden, outputs, batch, capacity, learning_rate, discount, target_rate,
    flops, seconds, compiled=False, seed=0,
):  # fmt: skip
    """Double DQN updates/s; ``flops`` are an update's, ``compiled``: by ``torch.compile``."""
    _begin(seed)
    online, target = _network(inputs, hidden, outputs), _network(inputs, hidden, outputs)
    target.load_state_dict(online.state_dict())
    adam = torch.optim.Adam(online.parameters(), lr=learning_rate, foreach=True)
    features, following = torch.randn(capacity, inputs), torch.randn(capacity, inputs)
    action, reward = torch.randint(outputs, (capacity, 1)), torch.randn(capacity)
    pairs = list(target.parameters()), list(online.parameters())

    def loss_of(index):
        with torch.no_grad():
            best = online(following[index]).argmax(1, keepdim=True)
            value = target(following[index]).gather(1, best).squeeze(1)
        q = online(features[index]).gather(1, action[index]).squeeze(1)
        return nn.functional.mse_loss(q, reward[index] + discount * value)

    forward = torch.compile(loss_of) if compiled else loss_of

    def step():
        loss = forward(torch.randint(capacity, (batch,)))
        adam.zero_grad()
        loss.backward()
        adam.step()
        with torch.no_grad():
            torch._foreach_lerp_(pairs[0], pairs[1], target_rate)

    began = time.perf_counter()
    for _ in range(50):
        step()
    warming = time.perf_counter() - began

    def timed():
        rate = timing.calls_per_second(step, seconds)
        gflops = rate * flops / 1e9
        return timing.result(rate, "updates/s", gflop_per_second=gflops, compile_seconds=warming)

    return timed


def _network(inputs, hidden, outputs):
    """A multilayer perceptron with ReLU between its layers."""
    layers = []
    for wide, narrow in pairwise([inputs, *hidden, outputs]):
        layers += [nn.Linear(wide, narrow), nn.ReLU()]
    return nn.Sequential(*layers[:-1])
