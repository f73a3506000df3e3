"""What an exported policy holds: all that its decisions depend on, as plain data and arrays."""

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lanewise import config
from lanewise.controllers import goal_critic, goals, planner
from lanewise.controllers.hierarchical import Hierarchical, Planned
from lanewise.controllers.single_level import SingleLevel
from lanewise.export.numpy_policy import FORMAT, VERSION, Policy
from lanewise.learning.network import NormalisedLayer
from lanewise.runs.trained import Trained
from lanewise.system.version import __version__
from lanewise.training import recipe


def policy(trained: Trained, digest: str, renewal: str | None = None) -> Policy:
    """A trained controller as a NumPy policy; ``digest`` is that of its run's settings.

    ``renewal`` says when goals are renewed; None as the run's settings say.

    Raises:
        ValueError: it is a reference driver, which has no policy.
    """
    driving, settings = trained.settings.driving, trained.settings
    if renewal is not None:
        settings = config.replace(settings, {"goals.test_renewal": renewal})
    about: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "lanewise": __version__,
        "controller": trained.name,
        "seed": trained.seed,
        "settings_digest": digest,
        "settings": config.dump_toml(settings),
        "task": list(trained.trained_with),
        "decision_frequency": driving.decision_frequency,
        "actions": asdict(driving.actions),
        "observation": asdict(driving.observation),
        "levels": {name: len(layers) for name, layers in trained.parameters.items()},
        "layer_normalisation": {
            name: isinstance(layers[0], NormalisedLayer)
            for name, layers in trained.parameters.items()
        },
    }
    arrays: dict[str, NDArray[Any]] = {
        f"{level}/{number}/{name}": np.asarray(array, np.float32)
        for level, layers in trained.parameters.items()
        for number, layer in enumerate(layers)
        for name, array in zip(("weights", "biases"), layer, strict=True)
    }
    match recipe.evaluation_config(trained.settings, trained.name, renewal).controller:
        case SingleLevel(hold=hold):
            about |= {"memory": "none" if hold == 1 else "held-action", "hold": hold}
        case Hierarchical() as controller:
            about |= _of_goals(controller)
        case Planned() as controller:
            car = {
                "ticks": driving.ticks_per_decision,
                "tick": driving.tick_duration,
                "decision": driving.decision_duration,
            }
            about |= _of_goals(controller) | {"planner": asdict(driving.actions) | car}
            turns, trims, trim_steps = planner.candidates(controller.planner.preview)
            arrays["planner/turns"] = turns.astype(np.float32)
            arrays["planner/trims"] = trims.astype(np.float32)
            arrays["planner/trim_steps"] = trim_steps.astype(np.int64)
        case _:
            raise ValueError(f"{trained.name} has no policy")
    return Policy(about, arrays)


def _of_goals(controller: Hierarchical | Planned) -> dict[str, Any]:
    """What goals depend on."""
    settings = controller.goals
    names = ("lowest_speed", "highest_speed", "speed_step", "lateral_tolerance", "speed_tolerance")
    described = {name: getattr(settings, name) for name in (*names, "reference")} | {
        "moves": goals.ACTION_SETS[settings.action_set],
        "renewal": controller.renewal,
        "lifetime": goal_critic.lifetime(settings, controller.driving, controller.renewal),
    }
    return {"memory": "goal", "goals": described}
