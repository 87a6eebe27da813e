"""Pictures of scenes by the software renderer."""

import exudyn as exu

import tdcr_fe as tdcr
from tdcr_fe.report.scene_picture import scene_picture


def test_a_robot_and_its_tendons_are_drawn_without_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    SC = exu.SystemContainer()
    mbs = SC.AddSystem()
    tendons = tuple(tdcr.Tendon(f"t{k + 1}", tdcr.ParallelRouting(4.5e-3, 120.0 * k)) for k in range(3))
    backbone = tdcr.Backbone(0.25, 0.4e-3, 85e9, 0.3)
    tdcr.CreateTDCR(mbs, tdcr.Robot(backbone, tdcr.Disks.equally_spaced(13, 0.25), tendons))
    mbs.Assemble()
    drawn = scene_picture(SC, center=[0.0, 0.0, 0.12], height=0.28, size=(450, 350))
    assert drawn.shape[:2] == (350, 450)
    drawn = drawn[..., :3] / (255.0 if drawn.max() > 1.0 else 1.0)
    # Backbone and disks, and the three tendons in their colours.
    assert (drawn.min(axis=2) < 0.7).mean() > 0.005
    red, green, blue = drawn[..., 0], drawn[..., 1], drawn[..., 2]
    for seen in (red > blue + 0.3, blue > red + 0.3, (green > red + 0.2) & (green > blue + 0.1)):
        assert seen.sum() > 20
