"""A policy file comes back as it was written, and anything else is refused with a sentence."""

import json
import pickle
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.numpy import load, save

from agents.policy import file as policy_file
from agents.policy.digest import canonical, digest
from agents.policy.features import size
from agents.policy.file import PolicyFile, PolicyFileError, parse, read, serialise, write
from agents.policy.schema import OBSERVATION, new_metadata
from envs.kinematics import SURROGATE

KEY = "rlcas_policy"


def content(hidden=(6, 5), feature_set="mirror", config=None, **training):
    rng = np.random.default_rng(1)
    actor, inputs = {}, size(feature_set)
    for name, width in zip(
        [*(f"hidden_{i}" for i in range(len(hidden))), "head"], [*hidden, 2], strict=True
    ):
        actor[f"{name}/kernel"] = rng.normal(size=(inputs, width)).astype(np.float32)
        actor[f"{name}/bias"] = rng.normal(size=width).astype(np.float32)
        inputs = width
    actor["log_std"] = np.full(2, -0.5, np.float32)
    config = (
        {"ppo": {"learning_rate": 3e-4, "epochs": 4}, "seeds": [1, 2]} if config is None else config
    )
    training = {
        "steps": 1000,
        "score": 12.5,
        "versions": {"numpy": "2"},
        "notes": 'a "note" with ünïcode\n',
    } | training
    metadata = new_metadata(hidden, feature_set, SURROGATE, config, **training)
    observation = rng.uniform(-1, 1, (3, 8)).astype(np.float32)
    return PolicyFile(actor, observation, rng.uniform(-1, 1, (3, 2)).astype(np.float32), metadata)


def rebuilt(tensors=None, change=None, seal=True):
    """Return a file in good form whose tensors, or metadata (changed in place), say
    something else.
    """
    policy = content()
    tensors = policy.tensors if tensors is None else tensors
    document = json.loads(canonical(policy.metadata))
    if change:
        change(document)
    document["sha256"] = digest(tensors, document) if seal else policy.sha256
    return save(tensors, metadata={KEY: canonical(document)})


DATA = serialise(content())
HEADER_END = 8 + struct.unpack("<Q", DATA[:8])[0]


@pytest.mark.parametrize(
    ("hidden", "feature_set"),
    [
        ((6, 5), "mirror"),
        ((4,), "none"),
    ],
)
def test_round_trip(tmp_path, hidden, feature_set):
    policy = content(hidden, feature_set)
    path = tmp_path / "p.safetensors"
    write(path, policy)
    again = read(str(path))
    assert again.tensors.keys() == policy.tensors.keys()
    for name, tensor in policy.tensors.items():
        assert again.tensors[name].dtype == np.float32
        np.testing.assert_array_equal(again.tensors[name], tensor)
    assert again.metadata == policy.metadata
    assert (
        again.sha256
        == policy.sha256
        == json.loads(header(path.read_bytes())["__metadata__"][KEY])["sha256"]
    )
    assert (again.hidden, again.feature_set, again.limits) == (hidden, feature_set, SURROGATE)
    assert serialise(again) == path.read_bytes()
    assert [entry.name for entry in tmp_path.iterdir()] == ["p.safetensors"]


def header(data):
    return json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])


def test_any_reader_of_the_format_can_open_it():
    assert load(DATA)["actor/head/kernel"].shape == (5, 2)
    assert list(header(DATA)["__metadata__"]) == [KEY]


def test_content_is_read_only():
    policy = parse(DATA, "p")
    with pytest.raises(ValueError, match="read-only"):
        policy.actor["log_std"][0] = 1.0


@settings(max_examples=300)
@given(st.integers(0, len(DATA) - 1), st.integers(1, 255))
def test_any_changed_byte_is_refused(position, flip):
    damaged = bytearray(DATA)
    damaged[position] ^= flip
    with pytest.raises(PolicyFileError, match=r"^p: "):
        parse(bytes(damaged), "p")


def test_every_byte_of_the_header_counts():
    """One exhaustive pass over the header, where a damage could change the spelling and not the
    meaning.
    """
    for position in range(HEADER_END):
        for value in (0x09, 0x20, 0x0A, DATA[position] ^ 0x20):
            if value != DATA[position]:
                with pytest.raises(PolicyFileError):
                    parse(DATA[:position] + bytes([value]) + DATA[position + 1 :], "p")


@settings(max_examples=100)
@given(st.one_of(st.integers(0, len(DATA) - 1), st.integers(0, HEADER_END)))
def test_truncated_anywhere_is_refused(length):
    with pytest.raises(PolicyFileError, match=r"^p: "):
        parse(DATA[:length], "p")


@given(st.binary(max_size=200))
def test_garbage_is_refused(data):
    with pytest.raises(PolicyFileError):
        parse(data, "p")


def test_trailing_bytes_are_refused():
    with pytest.raises(PolicyFileError, match="not a valid safetensors"):
        parse(DATA + b"\0", "p")


def forge(text):
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text


def with_header(change):
    """Return the file with its header's text changed."""
    text = change(DATA[8:HEADER_END].decode().rstrip(" ")).encode()
    return forge(text) + DATA[HEADER_END:]


def test_nothing_can_be_hidden_beside_the_content():
    assert with_header(str) == DATA
    more = {
        "an extra field": '"dtype":"F32","note":"x",',
        "the same twice": '"dtype":"F32","dtype":"F32",',
    }
    for entry in more.values():
        with pytest.raises(PolicyFileError, match=r"canonical|not a valid safetensors"):
            parse(
                with_header(lambda text, entry=entry: text.replace('"dtype":"F32",', entry, 1)), "p"
            )
    for blanks in (8, 16, 1_000_000):
        with pytest.raises(PolicyFileError, match="canonical"):
            parse(with_header(lambda text, blanks=blanks: text + " " * blanks), "p")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a valid safetensors"),
        (pickle.dumps({"actor": [1.0] * 100}), "not a valid safetensors"),
        (b"\xff" * 100, "not a valid safetensors"),
        (forge(b"\xff\xff"), "not a valid safetensors"),
        (forge(b"[" * 100_000), "not a valid safetensors"),
        (forge(b"[1]"), "not a valid safetensors"),
        (forge(b"{}"), "no policy metadata"),
        (forge(b'{"\\ud800":1}'), "not a valid safetensors"),
        (forge(b'{"a":1,"a":1}'), "not a valid safetensors"),
        (forge(b'{"__metadata__":{"rlcas_policy":"nonsense"}}'), "not canonical JSON"),
        (forge(b'{"__metadata__":{"rlcas_policy":"[NaN]"}}'), "not canonical JSON"),
        (forge(b'{"__metadata__":{"rlcas_policy":"[1]"}}'), "not one object"),
        (forge(b'{"__metadata__":{"rlcas_policy":"{ }"}}'), "canonical JSON: edited"),
        (forge(b'{"__metadata__":{"rlcas_policy":"{}"}}'), "metadata.schema is None"),
        (save({"a": np.zeros(3, np.float32)}), "no policy metadata"),
    ],
)
def test_what_is_no_policy_file(data, message):
    with pytest.raises(PolicyFileError, match=message):
        parse(data, "p")


def test_the_folder_of_a_training_is_its_policy(tmp_path: Path) -> None:
    (tmp_path / "policy.safetensors").write_bytes(DATA)
    assert serialise(read(tmp_path)) == serialise(parse(DATA, "p"))


def test_refused_paths(tmp_path, monkeypatch):
    with pytest.raises(PolicyFileError, match=r"none\.safetensors: no such policy file"):
        read(tmp_path / "none.safetensors")
    with pytest.raises(PolicyFileError, match=r"policy\.safetensors: no such policy file"):
        read(tmp_path)  # a folder without a policy
    (tmp_path / "file").write_bytes(DATA)
    with pytest.raises(PolicyFileError, match="cannot be read"):
        read(tmp_path / "file" / "below")
    with pytest.raises(PolicyFileError, match="not a regular file"):
        read("/dev/null")
    monkeypatch.setattr(policy_file, "MAX_BYTES", len(DATA) - 1)
    with pytest.raises(PolicyFileError, match=f"{len(DATA)} bytes, expected at most"):
        read(tmp_path / "file")
    with pytest.raises(PolicyFileError, match="expected at most"):
        serialise(content())


def at(path, value):
    """Return a change of one field of the metadata."""

    def change(document):
        *parents, last = path.split(".")
        for parent in parents:
            document = document[parent]
        if value is KeyError:
            del document[last]
        else:
            document[last] = value

    return change


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("schema.name", "other", "metadata.schema is .*'other'.*, expected .*'rlcas-policy'"),
        ("schema.version", 4, "metadata.schema is"),
        ("schema", KeyError, "metadata.schema is None"),
        (
            "observation.names",
            list(reversed(OBSERVATION["names"])),
            r"metadata\.observation\.names is",
        ),
        ("observation.half_range", [1.0] * 8, r"metadata\.observation\.half_range is"),
        ("observation.more", 1, r"metadata\.observation\.more is 1, expected None"),
        ("action.names", ["yaw_rate", "acceleration"], r"metadata\.action\.names is"),
        ("limits.speed_max", "fast", r"metadata\.limits\.speed_max is 'fast', expected a number"),
        ("limits.speed_max", 10.0, "expected those of a vehicle"),
        ("limits.speed_max", 400.1, "expected those of a vehicle"),
        ("limits.speed_max", 1e308, "expected those of a vehicle"),
        ("limits.acceleration_max", 21.0, "expected those of a vehicle"),
        ("limits.acceleration_min", -21.0, "expected those of a vehicle"),
        ("limits.yaw_rate_max", 1e308, "expected those of a vehicle"),
        ("limits.yaw_rate_max", 1e-300, "expected those of a vehicle"),
        ("limits.yaw_rate_max", KeyError, "metadata.limits lacks yaw_rate_max"),
        ("limits.colour", 1.0, "metadata.limits has unexpected 'colour'"),
        ("architecture.hidden", [], r"metadata\.architecture\.hidden is \[\]"),
        ("architecture.hidden", [6, True], "hidden is"),
        ("architecture.hidden", [10**9, 5], "hidden is"),
        ("architecture.hidden", [6, 4], r"shape \[6, 5\], expected \[6, 4\]"),
        ("architecture.hidden", [6], "tensor actor/hidden_1/bias' is unexpected"),
        ("architecture.hidden", [6, 5, 5], "tensor 'actor/hidden_2/bias' is missing"),
        ("architecture.activation", "relu", "activation is 'relu', expected 'tanh'"),
        ("architecture.output", "tanh", "output is 'tanh', expected 'clip'"),
        (
            "architecture.feature_set",
            "magic",
            "feature_set is 'magic', expected one of none, mirror",
        ),
        ("architecture.feature_set", "none", r"shape \[22, 6\], expected \[8, 6\]"),
        ("training.steps", -1, "steps is -1"),
        ("training.steps", 1.0, r"steps is 1\.0, expected an integer"),
        ("training.steps", True, "steps is True, expected an integer"),
        ("training.score", "good", "score is 'good', expected a number"),
        ("training.config", {"ppo": {}}, "config_sha256 is"),
        ("versions.numpy", 2, r"versions\.numpy is 2, expected a string"),
        ("notes", None, "notes is None, expected a string"),
        ("extra", 1, "metadata has unexpected 'extra'"),
        (
            "architecture.feature_set",
            "cpa",
            r"metadata\.architecture\.feature_set is 'cpa', expected one of none, mirror",
        ),
    ],
)
def test_wrong_metadata(path, value, message):
    with pytest.raises(PolicyFileError, match=message.replace("tensor actor", "tensor '?actor")):
        parse(rebuilt(change=at(path, value)), "p")


def alter(name, tensor):
    return {
        key: value
        for key, value in (content().tensors | {name: tensor}).items()
        if value is not None
    }


def nan_at(name, index, value=np.nan):
    tensor = content().tensors[name].copy()
    tensor[index] = value
    return alter(name, tensor)


@pytest.mark.parametrize(
    ("tensors", "message"),
    [
        (alter("actor/log_std", None), "tensor 'actor/log_std' is missing"),
        (alter("parity/action", None), "tensor 'parity/action' is missing"),
        (
            alter("critic/head/bias", np.zeros(1, np.float32)),
            "tensor 'critic/head/bias' is unexpected",
        ),
        (alter("actor/head/bias", np.zeros(3, np.float32)), r"shape \[3\], expected \[2\]"),
        (
            alter("actor/head/bias", np.zeros((2, 1), np.float32)),
            r"shape \[2, 1\], expected \[2\]",
        ),
        (alter("actor/head/bias", np.zeros(2, np.float64)), "dtype float64, expected float32"),
        (alter("actor/head/bias", np.zeros(2, np.float16)), "dtype float16, expected float32"),
        (alter("actor/head/bias", np.zeros(2, np.int32)), "dtype int32, expected float32"),
        (alter("parity/action", np.zeros((4, 2), np.float32)), r"hold \[3, 4\] vectors"),
        (
            alter("parity/action", np.zeros((0, 2), np.float32))
            | {"parity/observation": np.zeros((0, 8), np.float32)},
            r"hold \[0\] vectors",
        ),
        (
            nan_at("actor/hidden_1/kernel", (2, 3)),
            r"actor/hidden_1/kernel is not finite at \[2, 3\]",
        ),
        (nan_at("actor/head/kernel", (0, 0), -2e4), r"actor/head/kernel leaves \[-10000, 10000\]"),
        (nan_at("actor/log_std", 1, -np.inf), r"actor/log_std is not finite at \[1\]"),
        (nan_at("parity/observation", (0, 0), 1.5), r"parity/observation leaves \[-1, 1\]"),
        (nan_at("parity/action", (0, 0), -1.5), r"parity/action leaves \[-1, 1\]"),
    ],
)
def test_wrong_tensors(tensors, message):
    with pytest.raises(PolicyFileError, match=message):
        parse(rebuilt(tensors), "p")


def test_digest_is_checked():
    assert parse(rebuilt(), "p").sha256 == content().sha256
    for data in (
        rebuilt(nan_at("actor/head/bias", 0, 0.1), seal=False),
        rebuilt(change=at("notes", "better"), seal=False),
        rebuilt(change=at("training.score", 99.0), seal=False),
    ):
        with pytest.raises(PolicyFileError, match="edited or damaged"):
            parse(data, "p")


@pytest.mark.parametrize(
    ("config", "training"),
    [
        ({"rate": float("nan")}, {}),
        ({"rate": object()}, {}),
        ({}, {"steps": -5}),
        ({}, {"score": float("inf")}),
    ],
)
def test_metadata_that_cannot_be_written(config, training):
    with pytest.raises(PolicyFileError, match="new policy: "):
        content(config=config, **training)


def test_writing_refuses_what_reading_would_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "p.safetensors"
    write(path, content())
    before = path.read_bytes()
    policy = content()
    with pytest.raises(PolicyFileError, match="not finite"):
        write(
            path, replace(policy, actor={**policy.actor, "log_std": np.full(2, np.nan, np.float32)})
        )
    with pytest.raises(PolicyFileError, match="has dtype float64"):
        write(path, replace(policy, actor={**policy.actor, "log_std": np.zeros(2)}))
    assert path.read_bytes() == before
    write(path, content(notes="second"))
    assert read(path).metadata["notes"] == "second"
    assert [entry.name for entry in tmp_path.iterdir()] == ["p.safetensors"]


def test_failed_write_leaves_nothing_behind(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    with pytest.raises(PolicyFileError, match="cannot be written: No such file or directory"):
        write(tmp_path / "missing" / "p.safetensors", content())
    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(PolicyFileError, match="cannot be written: No space left"):
        write(tmp_path / "p.safetensors", content())
    assert list(tmp_path.iterdir()) == []
