"""Q-learning that knows no roads: network, targets, replay, exploration, learner."""
