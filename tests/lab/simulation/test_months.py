"""Months between map and scans: none with a share of 0, the same with a seed, every kind of change, more and more."""

from dataclasses import replace

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.dataset import Dataset
from maxcon.lab.simulation import simulate
from maxcon.lab.simulation.city import build_city
from maxcon.lab.simulation.furniture import LasClass
from maxcon.lab.simulation.months import Change, Months
from maxcon.lab.simulation.scanners import RayCaster
from maxcon.lab.simulation.streets import CAMPAIGN_GRID
from maxcon.lab.simulation.worlds import CampaignWorld, SimulatedWorld
from written_maps import run

SHARES, SEED = (0.0, 0.2, 0.5, 1.0), 3  # the seed is that of the worlds built once
GRID = CAMPAIGN_GRID._replace(u_lines=(0.0, 81.0), v_lines=(0.0, 69.0))


@pytest.fixture(scope="module")
def after():
    """The city, and what changed in it, by share."""
    found = {}
    for share in SHARES:
        months = Months(share, 7)
        found[share] = build_city(1, GRID, months), months.changes
    return found


def _count(city, las_class):
    return int((city.classes == las_class).sum())


def test_without_months_nothing_changes_and_the_same_seed_changes_the_same(after):
    np.testing.assert_array_equal(after[0.0][0].corners, build_city(1, GRID).corners)
    assert not after[0.0][1]
    np.testing.assert_array_equal(after[0.5][0].corners, build_city(1, GRID, Months(0.5, 7)).corners)
    other = build_city(1, GRID, Months(0.5, 8))
    assert other.corners.shape != after[0.5][0].corners.shape or (other.corners != after[0.5][0].corners).any()


def test_every_kind_of_change_is_there_and_there_is_more_of_it_with_a_larger_share(after):
    for change in Change:
        numbers = [after[share][1][change] for share in SHARES]
        assert 0 == numbers[0] < numbers[1] < numbers[2] < numbers[3], change
    for las_class in (LasClass.BUILDING, LasClass.HIGH_VEGETATION):  # demolished houses, bare trees
        numbers = [_count(after[share][0], las_class) for share in SHARES]
        assert numbers == sorted(numbers, reverse=True), las_class
    assert _count(after[0.0][0], LasClass.POLE) == _count(after[1.0][0], LasClass.POLE)
    houses = [after[1.0][1][change] for change in (Change.DEMOLITION, Change.SCAFFOLD)]
    assert 0.15 < houses[0] / sum(houses) < 0.35


def _height(city, x, y):
    """Height of what a ray meets that falls from 1 m above the carriageway."""
    down = RayCaster(city).cast(np.array([[x, y, 1.0]], np.float32), np.array([[0.0, 0.0, -1.0]], np.float32))
    return 1.0 - float(down.ranges[0])


def test_what_is_new_stands_before_the_houses_and_on_the_road(after):
    before, changed = after[0.0][0], after[1.0][0]
    x, y = before.parking_lanes[0].mean(axis=0)
    assert _height(before, x, y) == pytest.approx(0.0, abs=1e-5)
    assert _height(changed, x, y) == pytest.approx(0.05, abs=1e-5)
    new = changed.corners[changed.classes == LasClass.UNCLASSIFIED]
    lane = before.parking_lanes[0]
    way = (lane[1] - lane[0]) / np.linalg.norm(lane[1] - lane[0])
    rows = new.reshape(-1, 3)
    along, across = (rows[:, :2] - lane[0]) @ way, (rows[:, :2] - lane[0]) @ np.array([-way[1], way[0]])
    is_here = (along > 0.0) & (along < np.linalg.norm(lane[1] - lane[0])) & (np.abs(across) < 3.5)
    out = np.abs(across[is_here])  # from the parked cars, 2.85 m before the building line
    assert out.min() > 0.8
    heights = rows[is_here, 2]
    assert 0.3 < heights[out < 1.3].max() < 2.5  # fences and snow on the kerb
    assert heights[out > 1.4].max() > 8.0  # scaffolds


def test_the_car_drives_on_the_new_asphalt(campaign):
    worlds = campaign, CampaignWorld.build(SEED, 1, changed=0.6)
    for each in (worlds, [world.again(1) for world in worlds]):
        heights, raised = (world.scan_drive.positions[:, 2] for world in each)
        rise = raised - heights
        assert rise.min() >= 0.0 and rise.max() == pytest.approx(0.05)
        assert 0.2 < np.mean(rise > 0.045) < 0.9 and np.abs(np.diff(rise)).max() < 0.003
    assert campaign.scan_caster.city is campaign.scan_city and not campaign.changes


def test_the_ratio_of_returns_that_changed_grows(world, thin_scanner):
    worlds = [world, *(SimulatedWorld.build(SEED, before=30.0, after=20.0, changed=share) for share in (0.4, 1.0))]
    ratios = [each.changed_ratio(each.epochs(3), thin_scanner) for each in worlds]
    assert 0.05 < ratios[0] < 0.3  # other parked cars
    assert ratios == sorted(ratios) and ratios[-1] > ratios[0] + 0.3
    same = replace(world, scan_caster=world.mapping.caster)
    assert same.changed_ratio(same.epochs(2), thin_scanner) == 0.0


def test_a_dataset_says_how_much_changed_and_its_map_and_priors_are_as_without(dataset, small, thin_scanner, tmp_path):
    changed = simulate(tmp_path / "out", **small, changed=0.6)
    assert Dataset.open(changed.folder).changed == changed.changed > 0.3 and dataset.changed is None
    said = (changed.folder / "dataset.toml").read_text()
    assert all(f" {change}" in said for change in (Change.SCAFFOLD, Change.BARE_TREE))
    assert [path.name for path in changed.map_clouds] == [path.name for path in dataset.map_clouds]
    for name in ("map/trajectory.txt", "scans/times.txt"):
        assert (changed.folder / name).read_bytes() == (dataset.folder / name).read_bytes()


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_beyond_0_and_1_is_refused(share):
    with pytest.raises(OptionError, match="Expected the share that has changed since the map to be 0 to 1"):
        Months(share, 1)


def test_a_hard_campaign_knows_no_months():
    with pytest.raises(OptionError, match="either a hard campaign or months between map and scans, got both"):
        CampaignWorld.build(1, 1, is_hard=True, changed=0.5)


@pytest.mark.parametrize(
    ("options", "words"), [(("--campaign", "--hard"), "--hard"), (("--scene", "suburb"), "--scene suburb")]
)
def test_the_command_says_what_knows_no_months(tmp_path, options, words):
    with pytest.raises(OptionError, match=f"either --changed or {words}, got both"):
        run("simulate", tmp_path / "out", *options, "--changed", "0.2")
