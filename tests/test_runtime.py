"""Which processor a beat is computed on, in processes of their own: JAX is set up once for each."""

import os
import subprocess
import sys

import jax
import pytest

import eclsim


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


@pytest.mark.slow
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


UNWRITABLE = {"XLA_FLAGS": "--xla_dump_to=/dev/null/dump"}
"""Makes XLA log an error, as it does where a program takes two minutes to compile."""


def logged(**environment):
    """What a command writes to the terminal that has XLA compile a program, and whether it succeeded."""
    script = (
        "import eclsim.cli.application\n"
        "def run(_):\n    import jax; jax.jit(lambda x: x + 1.0)(1.0).block_until_ready()\n"
        "eclsim.cli.application.run = run\nfrom eclsim.cli import main; main([])"
    )
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "XLA_", "TF_"))}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=kept | environment, capture_output=True, text=True)
    return done.stderr, done.returncode == 0


@pytest.mark.slow
def test_the_log_of_xla_is_no_part_of_what_a_command_writes():
    """Lines such as "Very slow compile? If you want to file a bug ..." stood among the results."""
    assert logged(**UNWRITABLE) == ("", True)
    asked, _ = logged(**UNWRITABLE, TF_CPP_MIN_LOG_LEVEL="2")
    assert "Could not create directory" in asked


@pytest.mark.slow
def test_the_log_of_xla_is_no_part_of_what_a_script_writes():
    script = "import eclsim.runtime, jax; jax.jit(lambda x: x + 1.0)(1.0).block_until_ready()"
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "XLA_", "TF_"))}
    done = subprocess.run(
        [sys.executable, "-c", script], env=kept | UNWRITABLE, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""


def test_without_double_precision_nothing_is_computed():
    """Beats ended in an error about types of arrays, and gases of blood had six digits."""
    model = eclsim.Model.published(eclsim.circulation())
    with jax.enable_x64(False):
        for compute in (
            lambda: eclsim.simulate(model),
            lambda: eclsim.derivatives(model, ["MAP"], ["Rmc"]),
            lambda: eclsim.blood.gases(po2=95.0, pco2=40.0),
            lambda: eclsim.blood.base_excess(ph=7.4),
        ):
            with pytest.raises(RuntimeError, match="jax_enable_x64 is False"):
                compute()
    assert eclsim.blood.gases(po2=95.0, pco2=40.0).saturation.dtype == "float64"


@pytest.mark.slow
def test_what_ends_a_command_within_xla_is_written():
    said, succeeded = logged(XLA_FLAGS="--xla_no_such_flag=1")
    assert not succeeded
    assert "Unknown flag in XLA_FLAGS: --xla_no_such_flag=1" in said
