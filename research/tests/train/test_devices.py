"""Networks on other devices than the processor, as far as that can be seen without one."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from signsplice_paper.train.networks import spsn  # noqa: E402
from signsplice_paper.train.pairs_data import Batch  # noqa: E402
from system_toys import CONFIGS, part_toy, toy  # noqa: E402


@pytest.mark.parametrize("name", CONFIGS)
def test_a_step_needs_no_tensor_of_another_device(name: str) -> None:
    """Tensors on "meta" have no values: arithmetic with tensors that were left on the processor fails, as on a GPU."""
    device = torch.device("meta")
    task = toy(name).to(device)
    batch = part_toy(name)[1].batch(range(4), step=3).to(device)
    assert not isinstance(batch, Batch) or batch.numbers.device.type == "cpu", "noise is drawn from them"
    task(batch).backward()
    assert all(weights.grad is None or weights.grad.device == device for weights in task.parameters())


def test_small_differences_of_large_states_are_seen_in_half_precision() -> None:
    encoded = 30.0 + torch.linspace(0.0, 1.0, 5)[None, :, None].expand(1, 5, 8)
    exact = spsn.score(encoded, encoded)
    with torch.autocast("cpu", torch.bfloat16):
        found = spsn.score(encoded, encoded)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found, exact)
