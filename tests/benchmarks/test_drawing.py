from benchmarks.drawing import without_chance


def test_the_random_name_of_a_drawing_gives_way_to_its_own() -> None:
    svg = '<svg><defs id="defs-4d362c"><clipPath id="clip4d362cxy"/></defs><g clip-path="url(#clip4d362cxy)"/></svg>'

    assert without_chance(svg, "gains") == svg.replace("4d362c", "gains")


def test_a_drawing_without_one_stays_as_it_is() -> None:
    assert without_chance("<svg/>", "gains") == "<svg/>"
