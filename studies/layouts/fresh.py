"""Thirty more layouts, from the documentation of loggers and laboratories; `layouts.py FDM fresh` runs them.

Motion capture, inertial sensors, race cars, boats, oscilloscopes, chromatographs, plate readers, potentiostats, control rooms, pharmacometrics. They were
written before the readers knew any of them; `fresh.csv` has what was read then and now.
"""
from layouts import Layouts, floats, lag, oral, rows


def layouts(folder):
    put = Layouts(folder).text
    t, u, y = (floats(a) for a in lag())
    h, c = (floats(a) for a in oral())
    n, h0, c0 = len(t), h[1:], c[1:]
    minute = lambda v: 13 + int(v + 57.02) // 60
    second = lambda v: round((v + 57.02) % 60, 3)
    stamp = lambda v, form="14:{:02d}:{:06.3f}": form.format(minute(v), second(v))
    ms = [round(1000 * v) for v in t]
    # sampled from the first measured value on, so that a file without the empty first row is the same record
    dose = {"truth": [put("dose0.csv", "time [h],conc [mg/L]\n" + "".join(f"{a},{b}\n" for a, b in zip(h0, c0)))]}
    quote = lambda *columns: "".join(",".join(f'"{v}"' for v in row) + "\n" for row in zip(*columns))

    yield "race car: settings, names, units, blank lines", put(
        "motec.csv", '"Format","MoTeC CSV File",,,"Workbook","w"\n"Venue","ring",,,"Worksheet","s"\n"Vehicle","7",,,"Vehicle Desc",""\n"Driver","x",,,"Engine ID",""\n'
        '"Device","ADL"\n"Comment","",,,"Session","2"\n"Log Date","21/09/2026",,,"Origin Time","0.000","s"\n"Log Time","14:13:57",,,"Start Time","0.000","s"\n'
        '"Sample Rate","50.000","Hz",,"End Time","3.980","s"\n"Duration","3.980","s",,"Start Distance","0","m"\n"Range","entire outing",,,"End Distance","90","m"\n'
        '"Beacon Markers","1.2 2.4"\n\n\n"Time","u","y"\n"s","V",""\n\n\n' + quote([f"{v:.3f}" for v in t], u, y)), "lag", {}
    yield "water level: date, clock, milliseconds apart", put(
        "level.csv", "Serial_number:\n2042837\nProject ID:\nx\nLocation:\nwell\nLEVEL\nUNIT: m\nOffset: 0.000000 m\nDate,Time,ms,u,y\n"
        + rows([["2026/09/21"] * n, [stamp(v)[:8] for v in t], [round(1000 * (second(v) % 1)) for v in t], u, y])), "lag", {}
    yield "motion capture: rate alone in a line, frames", put(
        "vicon.csv", "Trajectories\n50\n,,rig:u,,rig:y,\nFrame,Sub Frame,X,Y,X,Y\n,,mm,mm,mm,mm\n"
        + rows([list(range(1, n + 1)), [0] * n, u, [0.5] * n, y, [0.25] * n])), "lag", {"u": "rig:u X [V]", "y": "rig:y X [1]"}
    yield "motion capture: six lines of titles", put(
        "motive.csv", "Format Version,1.23,Take Name,lag,Capture Frame Rate,50.000000,Export Frame Rate,50.000000,Rotation Type,XYZ,Length Units,Meters\n\n"
        ",,Rigid Body,Rigid Body,Rigid Body\n,,rig,rig,rig\n,,\"1\",\"1\",\"1\"\n,,Rotation,Position,Mean Marker Error\nFrame,Time (Seconds),X,X,\n"
        + rows([list(range(n)), [f"{v:.6f}" for v in t], u, y, [0.0002] * n])), "lag", {
            "u": "Rotation X [V]", "y": "Position X [1]"}
    yield "inertial sensor: remarks, counter, ticks", put(
        "xsens.txt", "// Start Time: Unknown\n// Update Rate: 50.0Hz\n// Filter Profile: general (39.1)\n// Option Flags: AHS Disabled\n// Firmware Version: 1.1.0\n"
        "PacketCounter\tSampleTimeFine\tu\ty\t\n" + rows([[7 + k for k in range(n)], [5190 + 200 * k for k in range(n)], u, y, [""] * n], "\t")), "lag", {}, {"option": "rate"}
    yield "inertial sensor: numbered packets", put("ximu.csv", "Packet number,u (V),y\n" + rows([[40 + k for k in range(n)], u, y])), "lag", {}, {"option": "rate"}
    yield "chromatogram: UTF-16, two columns, no names", put(
        "chem.csv", "".join(f"{a}\t{b}\r\n" for a, b in zip(h0, c0)), "utf-16"), "oral", {"t": "#1 [h]", "conc": "#2 [mg/L]"}, dose
    yield "chromatogram: sections in brackets", put(
        "lab.txt", "[Header]\nApplication Name\tLabSolutions\nVersion\t5.82\nOutput Date\t2026/09/21\n\n[File Information]\nType\tData File\nGenerated\t2026/09/21 14:13:57\n\n"
        f"[LC Chromatogram(Detector A-Ch1)]\nInterval(msec)\t500\n# of Points\t{len(h0)}\nStart Time(min)\t15.00\nEnd Time(min)\t1440.00\nIntensity Units\tmAU\n"
        "Intensity Multiplier\t0.001\nR.Time (min)\tIntensity\n" + "".join(f"{60 * a:.5f}\t{b}\n" for a, b in zip(h0, c0))), "oral", {"conc": "Intensity [mg/L]"}, dose
    hm = lambda a: f"{int(a)} h {round(60 * (a % 1))} min"
    yield "plate reader: a column for each time", put(
        "plate.csv", "User: USER,Path: C:\\data,Test ID: 12\nTest name: A600,Date: 21.09.2026,Time: 14:13:57\nAbsorbance\n\nWell Row,Well Col,Content," + ",".join(map(hm, h0))
        + "\nA,1,S1," + ",".join(str(v) for v in c0) + "\nA,2,B," + ",".join(["0.04"] * len(h0)) + "\n"), "oral", {"conc": "A1 [mg/L]"}, dose
    body = "".join(f'"{name}";"21.09.2026 {stamp(a)}";{v:.5f};1\n'.replace(f"{v:.5f}", f"{v:.5f}".replace(".", ",")) for a, b, d in zip(t, u, y) for name, v in (("u", b), ("y", d)))
    yield "control room: name, time, value, validity", put("wincc.csv", '"VarName";"TimeString";"VarValue";"Validity"\n' + body), "lag", {}
    yield "waveform as text: t0, delta t, decimal commas", put(
        "wave.txt", "waveform\t[0]\t[1]\nt0\t21.09.2026 14:13:57,020\t21.09.2026 14:13:57,020\ndelta t\t0,020000\t0,020000\n\ntime\tY[0]\tY[1]\n"
        + rows([["21.09.2026 " + stamp(v) for v in t], u, y], "\t").replace(".", ",").replace("21,09,2026", "21.09.2026")), "lag", {"u": "Y[0] [V]", "y": "Y[1] [1]"}
    yield "drone: milliseconds beside a date of whole seconds", put(
        "dji.csv", "time(millisecond),datetime(utc),satellites,u(V),isPhoto,y\n" + rows([ms, ["2026-09-21 " + stamp(v)[:8] for v in t], [17] * n, u, [0] * n, y])), "lag", {}
    yield "drone: loop iteration, flags in words", put(
        "bbl.csv", "loopIteration, time (us), u (V), y, flightModeFlags (flags), failsafePhase (flags)\n"
        + rows([[16 * k for k in range(n)], [f" {31_000_000 + 1000 * v}" for v in ms], [f" {v}" for v in u], [f" {v}" for v in y], [" ANGLE_MODE"] * n, [" IDLE"] * n])), "lag", {}
    yield "oscilloscope: segments behind #", put(
        "lecroy.csv", "LECROYWR640,12345,Waveform\nSegments,1,SegmentSize,200\nSegment,TrigTime,TimeSinceSegment1\n#1,21-Sep-2026 14:13:57,0\nTime,Ampl,Ampl\n"
        + rows([t, u, y])), "lag", {"u": "#2 [V]", "y": "#3 [1]"}
    yield "oscilloscope: in s, CH1 in V", put("rs.csv", "in s,CH1 in V,CH2 in V\n" + rows([t, u, y], ",", "{:.5E}")), "lag", {"u": "CH1", "y": "CH2 [1]"}
    yield "oscilloscope: Second, Volt, Volt", put(
        "siglent.csv", "Record Length,Analog:200\nSample Interval,2.0000000000E-02\nVertical Units,CH1:V,CH2:V,\nVertical Scale,CH1:0.50,CH2:0.50,\nHorizontal Units,s\n"
        "Model Number,SDS1104\nSerial Number,1\nSoftware Version,8.2\nSource,CH1,CH2\nSecond,Volt,Volt\n" + rows([t, u, y])), "lag", {"u": "#2 [V]", "y": "#3 [1]"}
    try:
        import openpyxl
        book = openpyxl.Workbook()
        for line in [["Versuch 12", None, None, None], [], ["Zeit", "Antrieb", None, "Messung"], [None, "u", "i", "y"], ["s", "V", "A", None]]:
            book.active.append(line)
        for row in zip(t, u, [0.1] * n, y):
            book.active.append(row)
        book.active.merge_cells("B3:C3")
        book.active.merge_cells("A3:A4")
        book.save(folder / "merged.xlsx")
        yield "XLSX with merged titles", folder / "merged.xlsx", "lag", {}
    except ImportError:
        print("XLSX is left out: there is no openpyxl")
    yield "table of NONMEM: title, exponents", put(
        "sdtab1", "TABLE NO.  1\n ID          TIME        DV          IPRED       MDV\n"
        + "".join(f"  1.0000E+00  {a:.4E}  {b:.4E}  {b:.4E}  0.0000E+00\n" for a, b in zip(h0, c0))), "oral", {}, {"truth": [put(
            "dose4.csv", "time [h],conc [mg/L]\n" + "".join(f"{a},{float(f'{b:.4E}')}\n" for a, b in zip(h0, c0)))]}
    yield "population data: semicolons, Y, censoring", put(
        "monolix.csv", "ID;TIME;AMT;Y;CENS;EVID\n1;0;320;.;0;1\n" + "".join(f"1;{a};.;{b};0;0\n" for a, b in zip(h0, c0))), "oral", {"conc": "Y"}, {"truth": [put(
            "dosed.csv", "time [h],conc [mg/L]\n0,\n" + "".join(f"{a},{b}\n" for a, b in zip(h0, c0)))]}
    yield "potentiostat: tabulator first, units below", put(
        "gamry.dta", "EXPLAIN\nTAG\tCHRONOA\nTITLE\tLABEL\tChronoamperometry\tTest\nDATE\tLABEL\t21.09.2026\tDate\nTIME\tLABEL\t14:13:57\tTime\nVPRESTEP\tPOTEN\t0.0E+000\tT\n"
        f"CURVE\tTABLE\t{n}\n\tPt\tT\tu\ty\tIERange\n\t#\ts\tV\t\t#\n" + "".join(f"\t{k}\t{a}\t{b}\t{d}\t9\n" for k, (a, b, d) in enumerate(zip(t, u, y)))), "lag", {}
    clock = lambda a: f"{int(a)}:{round(60 * (a % 1)):02d}:00"
    yield "reactor: clock from 0:00:00 beside a constant T", put(
        "clock.csv", "Clock,T,conc [mg/L]\n" + "".join(f"{clock(a)},37.0,{b}\n" for a, b in zip(h0, c0))), "oral", {}, dose
    yield "wristband: rate in a line of dashes, no time", put(
        "act.csv", "------------ Data File Created By ActiGraph GT3X+ ActiLife v6.13.3 Firmware v2.5.0 date format M/d/yyyy at 50 Hz  Filter Normal -----------\n"
        "Serial Number: NEO1\nStart Time 14:13:57\nStart Date 9/21/2026\nEpoch Period (hh:mm:ss) 00:00:00\nDownload Time 15:00:00\nDownload Date 9/21/2026\n"
        "Current Memory Address: 0\nCurrent Battery Voltage: 4.21     Mode = 12\n--------------------------------------------------\nu,y\n" + rows([u, y])), "lag", {}, {"option": "rate"}
    yield "sensor: sep= in the first line, units below", put(
        "shimmer.csv", '"sep=\t"\nS_Timestamp_Unix_CAL\tS_u_CAL\tS_y_CAL\t\nms\tV\tno units\t\n' + rows([[f"{1_790_000_000_000 + v}.0" for v in ms], u, y, [""] * n], "\t")), "lag", {
            "u": "S_u_CAL", "y": "S_y_CAL [1]"}
    yield "wristband: start and rate as first rows, no names", put(
        "e4.csv", "1790000000.000000, 1790000000.000000\n50.000000, 50.000000\n" + rows([u, y], ",")), "lag", {"u": "#1 [V]", "y": "#2 [1]"}, {"option": "rate"}
    yield "logger: month first, hundredths, trailing comma", put(
        "open.csv", "rtcDate,rtcTime,u,y,output_Hz,\n" + rows([["09/21/2026"] * n, [stamp(v, "14:{:02d}:{:05.2f}") for v in t], u, y, [50.0] * n, [""] * n])), "lag", {}
    yield "race car: name, unit, range and rate by bars", put(
        "rc.csv", '"Interval"|"ms"|0|0|1,"Utc"|"ms"|0|0|1,"u"|"V"|0.0|5.0|50,"y"|""|-5.0|5.0|50\n' + rows([ms, [1_790_000_000_000 + v for v in ms], u, y])), "lag", {}
    yield "serial plotter: name:value", put("plot.txt", "".join(f"t:{a:.2f},u:{b},y:{d}\n" for a, b, d in zip(t, u, y))), "lag", {}
    yield "Fortran: exponents with D", put(
        "fort.dat", "    TIME             U              Y\n" + "".join(f"  {a:.8E}  {b:.8E}  {d:.8E}\n".replace("E", "D") for a, b, d in zip(t, u, y))), "lag", {"u": "U", "y": "Y"}
    yield "thousands set apart by commas, quoted", put("office.csv", '"time (ms)","u","y"\n' + quote([f"{v + 1532:,}" for v in ms], u, y)), "lag", {}
    field = lambda k, a, b, d: f'Data,0,record,timestamp,"{k}",ms,u,"{b}",V,y,"{d}",,\n'
    yield "wrist watch: field, value, unit in each row", put(
        "fit.csv", "Type,Local Number,Message,Field 1,Value 1,Units 1,Field 2,Value 2,Units 2,Field 3,Value 3,Units 3,\n"
        'Definition,0,record,timestamp,1,,u,1,,y,1,,\n' + "".join(field(k, a, b, d) for k, a, b, d in zip(ms, t, u, y))), "lag", {}
