"""Which processor a beat is computed on, in processes of their own: JAX is set up once for each."""

import os
import subprocess
import sys

import pytest


def printed(script, **environment):
    """What a script prints in a process of its own, whose environment names no platform of JAX."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=kept | environment, capture_output=True, text=True, check=True)
    return done.stdout.split()[-1]


def default_device(before="", **environment):
    """What a program that imports eclsim finds as JAX's default device."""
    script = f"import jax; {before}\nimport eclsim.runtime; print(jax.config.jax_default_device)"
    return printed(script, **environment)


def test_beats_are_computed_on_the_cpu_also_beside_a_graphics_processor():
    assert default_device() == default_device(JAX_PLATFORMS="cuda,cpu") == "cpu"


@pytest.mark.parametrize(
    ("before", "environment"),
    [("", {"JAX_PLATFORMS": "cuda"}), ("jax.config.update('jax_default_device', 'gpu')", {})],
    ids=["no other platform", "chosen before"],
)
def test_what_the_user_chose_stays(before, environment):
    assert default_device(before, **environment) == ("gpu" if before else "None")


def test_the_commands_start_no_graphics_processor():
    run = "from eclsim.cli import main\ntry:\n    main(['--version'])\nexcept SystemExit:\n    pass"
    assert printed(f"{run}\nimport os; print(os.environ['JAX_PLATFORMS'])") == "cpu"
