"""Settings of all tests: Hypothesis repeats its examples from run to run unless a search for new
ones is asked for.

What JAX compiles is kept as the programs keep it, for the other processes of a run and for later
runs."""

import gc
import os
from collections.abc import Callable, Generator, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from commands.command import InputError
from commands.compiled import keep_compiled
from envs import compiled

_COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("repeatable", derandomize=True, max_examples=30, **_COMMON)
settings.register_profile(
    "search", derandomize=False, max_examples=1000, print_blob=True, **_COMMON
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))


keep_compiled()  # pytest's workers and the programs that tests start inherit it


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option to run what can be compiled compiled."""
    parser.addoption("--compiled", action="store_true", help="fly by compiled code (numba)")


@pytest.fixture(scope="session", autouse=True)
def _compiled(request: pytest.FixtureRequest) -> None:
    """Compile before the first test where that is asked for."""
    if request.config.getoption("--compiled"):
        compile_planner()


@pytest.fixture(autouse=True)
def _use_of_compiled_code() -> Iterator[None]:
    """Leave the next test of the process what this one found: nodes and commands that a test runs
    in this process compile.
    """
    in_use = compiled.in_use()
    yield
    compiled.use(in_use)


@pytest.fixture(scope="module")
def compiled_code() -> Iterator[None]:
    """Fly by compiled code in a module of tests, which is slow: it compiles for a minute first."""
    if not compiled.may_compile():
        pytest.skip("numba may not compile; to have it: pip install '.[fast]'")
    in_use = compiled.in_use()
    compile_planner()
    yield
    compiled.use(in_use)


def compile_planner() -> None:
    """Compile all that plans."""
    import agents.planner  # noqa: F401

    compiled.prepare()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect no garbage while every library is imported: it takes a quarter of the time and finds
    none.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mix files that compute with those that wait, so that the last files are short; the order
    within a file stays. What compiles first, or opens a browser, is slow; a run of compiled code
    leaves out what compiles.
    """
    compiles = [item for item in items if "compiled_code" in _fixtures(item)]
    for item in items:
        if {"compiled_code", "new_page"} & set(_fixtures(item)):
            item.add_marker(pytest.mark.slow)
    if config.getoption("--compiled"):
        items[:] = [item for item in items if item not in compiles]
    items.sort(key=lambda item: item.path.name, reverse=True)


def _fixtures(item: pytest.Item) -> list[str]:
    return getattr(item, "fixturenames", [])


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Keep which functions of tests, or whole files, were passed over, for a run that has what they
    need (`.pytest_cache/v/passed_over`).
    """
    skipped = terminalreporter.stats.get("skipped", [])
    cache = getattr(config, "cache", None)
    if cache is not None:  # -p no:cacheprovider
        cache.set("passed_over", sorted({report.nodeid.partition("[")[0] for report in skipped}))


@pytest.fixture(autouse=True, scope="module")
def freeze_what_stays() -> None:
    """Spare the garbage collector, in every file, what earlier files left for good: millions of
    objects of JAX.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def share_programs() -> Iterator[None]:
    """Let the trainings of this process that differ in no compiled key share their programs."""
    from agents.config.load import dump
    from rlcas_jax import loop
    from rlcas_jax.config import CheckpointConfig, TrainConfig
    from rlcas_jax.devices import Devices
    from rlcas_jax.task import CompiledTask

    compile_task, tasks = loop.build, dict[tuple[str, int], CompiledTask]()
    outside = {"warm_start": None, "checkpoint": CheckpointConfig()}

    def build(config: TrainConfig, devices: Devices | None = None, phase: int = 0) -> CompiledTask:
        key = dump(config.model_copy(update=outside)), phase
        if key not in tasks:
            tasks[key] = compile_task(config, devices, phase)
        return tasks[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "build", build)
        yield


@pytest.fixture(scope="module")
def new_page() -> Iterator[Callable[..., Any]]:
    """Return what opens a page in a real browser; the page waits longer than a busy machine
    needs.
    """
    from benchmarks.measure import find_chromium

    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    try:
        chromium = find_chromium()
    except InputError as problem:
        pytest.skip(str(problem))
    with playwright.sync_playwright() as driver:
        # No sandbox: as root, which continuous integration is, Chromium starts no other way; the
        # page is our own.
        browser = driver.chromium.launch(
            executable_path=chromium, args=["--no-sandbox"], timeout=240_000.0
        )

        def open_page(**settings: Any) -> Any:
            page = browser.new_page(**settings)
            page.set_default_timeout(240_000.0)
            return page

        yield open_page
        browser.close()
