"""Inspection of robots with many joints."""

import pytest

from steelyard.cli.main import main


def chain(count):
    links = "".join(f'<link name="link{k}"/>' for k in range(count + 1))
    joints = "".join(
        f'<joint name="joint{k}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/>'
        f'<origin xyz="0.1 0 0.05" rpy="{1.5707963267948966 * (k % 2)} 0 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="2" effort="9"/></joint>'
        for k in range(count)
    )
    return f'<robot name="chain">{links}{joints}</robot>'


@pytest.mark.parametrize(("count", "counted"), [(6, True), (50, False)])
def test_regressors_of_long_chains_are_not_built(count, counted, tmp_path, capsys, monkeypatch):
    """The regressor of 300 joints is half a million expressions, minutes and gigabytes."""
    path = tmp_path / "chain.urdf"
    path.write_text(chain(count))
    monkeypatch.setattr("sys.argv", ["steelyard", "inspect", str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert ("base regressor" in text) is counted
    assert (f"{count * (count + 1) // 2} blocks" in text) is not counted
    assert text.count(" + ") > 5 * count
