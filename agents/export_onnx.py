"""``python -m agents.export_onnx``: see :mod:`agents.policy.onnx`."""

from agents.config.load import run_cli
from agents.policy.onnx import ExportError, main
from agents.policy.schema import PolicyFileError

if __name__ == "__main__":
    run_cli(main, PolicyFileError, ExportError)
