#!/usr/bin/env python3
"""Writes src/report/page/mathematics.ttf: what browsers need of a math font where a machine has none.

Browsers place indices, fractions and roots by the table MATH of the first font of a formula that has a space. Most machines have no
font with that table: indices then stay on the line, and fractions are struck through. This font has the table, a space, and the signs
that stretch; letters come from the fonts behind it. Constants are those of TeX's font cmsy10 (Knuth, The TeXbook, appendices F and G),
in thousandths of an em. Outlines are drawn here.

    pip install fonttools
    python3 studies/pages/math_font.py
"""

import os
from pathlib import Path

os.environ["SOURCE_DATE_EPOCH"] = "0"  # the same bytes on every day

from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import newTable
from fontTools.ttLib.tables import otTables as ot

EM, AXIS, RULE = 1000, 250, 40
HEIGHTS = [1000, 1400, 1900, 2500, 3200, 4200]  # of the sizes of a sign

CONSTANTS = {
    "ScriptPercentScaleDown": 70, "ScriptScriptPercentScaleDown": 50,
    "DelimitedSubFormulaMinHeight": 1500, "DisplayOperatorMinHeight": 1400,
    "MathLeading": 150, "AxisHeight": AXIS, "AccentBaseHeight": 431, "FlattenedAccentBaseHeight": 683,
    "SubscriptShiftDown": 200, "SubscriptTopMax": 344, "SubscriptBaselineDropMin": 50,
    "SuperscriptShiftUp": 413, "SuperscriptShiftUpCramped": 289, "SuperscriptBottomMin": 108, "SuperscriptBaselineDropMax": 386,
    "SubSuperscriptGapMin": 4 * RULE, "SuperscriptBottomMaxWithSubscript": 344, "SpaceAfterScript": 50,
    "UpperLimitGapMin": 111, "UpperLimitBaselineRiseMin": 200, "LowerLimitGapMin": 167, "LowerLimitBaselineDropMin": 600,
    "StackTopShiftUp": 444, "StackTopDisplayStyleShiftUp": 677, "StackBottomShiftDown": 345, "StackBottomDisplayStyleShiftDown": 686,
    "StackGapMin": 3 * RULE, "StackDisplayStyleGapMin": 7 * RULE,
    "StretchStackTopShiftUp": 200, "StretchStackBottomShiftDown": 600, "StretchStackGapAboveMin": 111, "StretchStackGapBelowMin": 167,
    "FractionNumeratorShiftUp": 394, "FractionNumeratorDisplayStyleShiftUp": 677,
    "FractionDenominatorShiftDown": 345, "FractionDenominatorDisplayStyleShiftDown": 686,
    "FractionNumeratorGapMin": RULE, "FractionNumDisplayStyleGapMin": 3 * RULE, "FractionRuleThickness": RULE,
    "FractionDenominatorGapMin": RULE, "FractionDenomDisplayStyleGapMin": 3 * RULE,
    "SkewedFractionHorizontalGap": 350, "SkewedFractionVerticalGap": 96,
    "OverbarVerticalGap": 3 * RULE, "OverbarRuleThickness": RULE, "OverbarExtraAscender": RULE,
    "UnderbarVerticalGap": 3 * RULE, "UnderbarRuleThickness": RULE, "UnderbarExtraDescender": RULE,
    "RadicalVerticalGap": 50, "RadicalDisplayStyleVerticalGap": 148, "RadicalRuleThickness": RULE, "RadicalExtraAscender": RULE,
    "RadicalKernBeforeDegree": 278, "RadicalKernAfterDegree": -556, "RadicalDegreeBottomRaisePercent": 60,
}


def polygon(pen, points):
    pen.moveTo(points[0])
    for point in points[1:]:
        pen.lineTo(point)
    pen.closePath()


def round_bracket(pen, low, high, mirror):
    """A crescent: thin at its ends, thickest in the middle."""
    tall = high - low
    x = lambda v: 360 - v if mirror else v
    pen.moveTo((x(310), high))
    pen.qCurveTo((x(60), high - tall // 4), (x(60), low + tall // 4), (x(310), low))
    pen.lineTo((x(335), low + 10))
    pen.qCurveTo((x(135), low + tall // 4), (x(135), high - tall // 4), (x(335), high - 10))
    pen.closePath()
    return 390


def square_bracket(pen, low, high, mirror):
    x = lambda v: 320 - v if mirror else v
    corners = [(90, low), (290, low), (290, low + 45), (145, low + 45), (145, high - 45), (290, high - 45), (290, high), (90, high)]
    polygon(pen, [(x(a), b) for a, b in corners])
    return 330


def brace(pen, low, high, mirror):
    """Two hooks that meet in a tip."""
    middle = (low + high) // 2
    x = lambda v: 420 - v if mirror else v
    pen.moveTo((x(370), high))
    pen.qCurveTo((x(195), high - 20), (x(195), high - 180))
    pen.lineTo((x(195), middle + 150))
    pen.qCurveTo((x(195), middle + 20), (x(50), middle))
    pen.qCurveTo((x(195), middle - 20), (x(195), middle - 150))
    pen.lineTo((x(195), low + 180))
    pen.qCurveTo((x(195), low + 20), (x(370), low))
    pen.lineTo((x(370), low + 35))
    pen.qCurveTo((x(255), low + 50), (x(255), low + 190))
    pen.lineTo((x(255), middle - 140))
    pen.qCurveTo((x(255), middle - 30), (x(150), middle))
    pen.qCurveTo((x(255), middle + 30), (x(255), middle + 140))
    pen.lineTo((x(255), high - 190))
    pen.qCurveTo((x(255), high - 50), (x(370), high - 35))
    pen.closePath()
    return 420


def bar(pen, low, high, _):
    polygon(pen, [(115, low), (165, low), (165, high), (115, high)])
    return 280


def radical(pen, low, high, _):
    """A tick, a heavy stroke down, a thin one up to where the rule begins."""
    tall = high - low
    knee = low + min(tall * 55 // 100, 700)
    polygon(pen, [(70, knee - 60), (220, knee), (430, low + 170), (800, high), (850, high), (850, high - RULE), (450, low), (400, low),
                  (170, knee - 80), (85, knee - 100)])
    return 850


SIGNS = {
    "parenleft": (0x28, round_bracket, False), "parenright": (0x29, round_bracket, True),
    "bracketleft": (0x5B, square_bracket, False), "bracketright": (0x5D, square_bracket, True),
    "braceleft": (0x7B, brace, False), "braceright": (0x7D, brace, True),
    "bar": (0x7C, bar, False), "radical": (0x221A, radical, False),
}


def outlines():
    """Glyphs with their widths; of every sign one for each height, about the axis."""
    empty = TTGlyphPen(None).glyph()
    glyphs, widths = {".notdef": empty, "space": empty}, {".notdef": 500, "space": 250}
    for name, (_, draw, mirror) in SIGNS.items():
        for k, tall in enumerate(HEIGHTS):
            pen = TTGlyphPen(None)
            own = name if k == 0 else f"{name}.{k}"
            widths[own] = draw(pen, AXIS - tall // 2, AXIS + tall // 2, mirror)
            glyphs[own] = pen.glyph()
    return glyphs, widths


def value(v):
    record = ot.MathValueRecord()
    record.Value, record.DeviceTable = v, None
    return record


def mathematics(order):
    table = ot.MATH()
    table.Version = 0x00010000
    constants = ot.MathConstants()
    for name, v in CONSTANTS.items():
        plain = name.endswith(("PercentScaleDown", "MinHeight", "RaisePercent"))
        setattr(constants, name, v if plain else value(v))
    # browsers check tables before they use them, and want this one even where it says nothing
    information = ot.MathGlyphInfo()
    information.MathItalicsCorrectionInfo = information.MathTopAccentAttachment = None
    information.ExtendedShapeCoverage = information.MathKernInfo = None
    table.MathConstants, table.MathGlyphInfo = constants, information
    variants = ot.MathVariants()
    variants.MinConnectorOverlap = 0
    names = sorted(SIGNS, key=order.index)
    coverage = ot.Coverage()
    coverage.glyphs = names
    variants.VertGlyphCoverage, variants.VertGlyphCount = coverage, len(names)
    variants.HorizGlyphCoverage, variants.HorizGlyphCount, variants.HorizGlyphConstruction = None, 0, []
    variants.VertGlyphConstruction = []
    for name in names:
        construction = ot.MathGlyphConstruction()
        construction.GlyphAssembly, construction.MathGlyphVariantRecord = None, []
        for k, tall in enumerate(HEIGHTS):
            record = ot.MathGlyphVariantRecord()
            record.VariantGlyph, record.AdvanceMeasurement = name if k == 0 else f"{name}.{k}", tall
            construction.MathGlyphVariantRecord.append(record)
        construction.VariantCount = len(construction.MathGlyphVariantRecord)
        variants.VertGlyphConstruction.append(construction)
    table.MathVariants = variants
    wrapped = newTable("MATH")
    wrapped.table = table
    return wrapped


def main():
    glyphs, widths = outlines()
    order = list(glyphs)
    builder = FontBuilder(EM, isTTF=True)
    builder.setupGlyphOrder(order)
    builder.setupCharacterMap({0x20: "space"} | {code: name for name, (code, _, _) in SIGNS.items()})
    builder.setupGlyf(glyphs)
    sides = {name: getattr(builder.font["glyf"][name], "xMin", 0) for name in order}
    builder.setupHorizontalMetrics({name: (widths[name], sides[name]) for name in order})
    builder.setupHorizontalHeader(ascent=800, descent=-250)
    builder.setupNameTable({"familyName": "fdm mathematics", "styleName": "Regular"})
    builder.setupOS2(sTypoAscender=800, sTypoDescender=-250, usWinAscent=800, usWinDescent=250, sxHeight=431, sCapHeight=683)
    builder.setupPost(keepGlyphNames=False)
    builder.font["head"].created = builder.font["head"].modified = 0
    builder.font["MATH"] = mathematics(order)
    path = Path(__file__).resolve().parents[2] / "src/report/page/mathematics.ttf"
    builder.save(path)
    print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
