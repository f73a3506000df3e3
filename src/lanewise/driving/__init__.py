"""The decision process around the ego: percept, actions, reward, accidents, episode."""
