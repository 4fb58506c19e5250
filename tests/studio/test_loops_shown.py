"""Margins of a law's loops on the page."""

import re
from dataclasses import replace

import polefence as pf
from polefence.certify.bounds import best_bound
from polefence.requirements.disk_margin import DiskMargin
from polefence.studio.loops import loops_of

REGION = pf.Disk(-40, 31)


def test_the_disk_margin_that_is_said_to_be_proved_is_proved(physical):
    design = pf.place(physical, REGION)
    text = loops_of(design)
    (proved,) = re.findall(r"actuator force.*?; ([\d.]+) proved", text)
    bound = best_bound(physical, design.law, DiskMargin("actuator force"))
    assert float(proved) <= 1 / bound.level
    assert float(proved) > 0.999 / bound.level
    assert text.count("<tr>") == 1 + 1 + len(physical.states)
    assert text.count("data:image/svg+xml;base64,") == 1


def test_names_are_no_markup(physical):
    hostile = replace(physical, vehicle=None, inputs=('<b onload="x">f</b> [N]',))
    text = loops_of(pf.place(hostile, REGION))
    assert "<b" not in text
    assert "&lt;b" in text
