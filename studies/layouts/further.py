"""Twenty layouts from manuals of loggers, oscilloscopes and laboratories, written after the readers were finished; `layouts.py FDM further` runs them.

Each is as its manual or the software's own files have it. No reader was changed for one of them before the first score.
"""
from layouts import Layouts, floats, lag, rows


def layouts(folder):
    put = Layouts(folder).text
    t, u, y = (floats(a) for a in lag())
    n = len(t)
    clock = lambda v: (13 + int(v + 58.2) // 60, (v + 58.2) % 60)
    stamp = lambda v: "14:{:02d}:{:06.3f}".format(*clock(v))
    ms = [1000 * v for v in t]
    yield "oscilloscope: names, (ms),(V), blank line", put(
        "pico.csv", "Time,Channel A,Channel B\n(ms),(V),(V)\n\n" + rows([ms, u, y])), "lag", {"u": "Channel A", "y": "Channel B [1]"}
    yield "simulator: quoted names and units behind blanks", put(
        "twin.csv", '"Time [ms]", "u [V]", "y [1]"\n' + rows([ms, u, y], ", ")), "lag", {}
    body = "".join(f",,{k},2026-09-21T14:13:00Z,2026-09-21T14:15:00Z,2026-09-21T{stamp(a)}Z,{row[i]},{f},drive,A\n"
                   for k, (f, row) in enumerate([("u", u), ("y", y)]) for i, a in enumerate(t))
    yield "time series data base, annotated", put(
        "influx.csv", "#group,false,false,true,true,false,false,true,true,true\n#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string,string\n"
        "#default,mean,,,,,,,,\n,result,table,_start,_stop,_time,_value,_field,_measurement,host\n" + body), "lag", {}
    head = ["EC-Lab ASCII FILE", "Nb header lines : 12", "", "Chronoamperometry", "", "Run on channel : 1 (SN 14990)", "Electrode connection : standard",
            "Ei (V)              0,350", "dt (s)              0,1000", "nc cycles           0", ""]
    yield "potentiostat: names/unit, decimal commas", put("ec.mpt", "\n".join(head) + "\nmode\ttime/s\tcontrol/V\ty\t\n"
                                                         + rows([["2"] * n, t, u, y, [""] * n], "\t").replace(".", ",")), "lag", {"u": "control/V"}
    hms = lambda v: "14{:02d}{:06.3f}".format(*clock(v))
    yield "GPS logger: [column names], [data], hhmmss.ss", put(
        "v.vbo", "File created on 21/09/2026 at 14:13:57\n\n[header]\nsatellites\ntime\nu\ny\n\n[comments]\n(c) 2026\nLog Rate (Hz) : 50.00\n\n[column names]\nsats time u y\n\n[data]\n"
        + rows([["008"] * n, [hms(v) for v in t], [f"{v:+09.4f}" for v in u], [f"{v:+010.5f}" for v in y]], " ")), "lag", {}
    whole = [f"2026-09-21 14:{13 + int(v + 58.2) // 60:02d}:{int(v + 58.2) % 60:02d}" for v in t]
    yield "terminal unit: whole seconds, trailing semicolons", put(
        "rtu.csv", "Date;plc.u;plc.y;\n" + rows([whole, u, y, [""] * n], ";")), "lag", {"u": "plc.u", "y": "plc.y"}, {"option": "rate"}
    pid = "".join(f'"{a:.5f}";"{name}";"{v}";"{unit}";\n' for a, b, d in zip(t, u, y) for name, v, unit in (("u", b, "V"), ("y", d, "")))
    yield "car: seconds, name, value, units", put("obd.csv", '"SECONDS";"PID";"VALUE";"UNITS";\n' + pid), "lag", {}
    yield "flight simulator: tabulators, units in words", put(
        "fg.txt", "time (sec)\tu (Volts)\ty\n" + rows([t, u, y], "\t")), "lag", {}
    line = lambda name, values: name + "," + ",".join(f"{v:.5f}" for v in values) + "\n"
    yield "plate reader: signals in rows under a head", put(
        "plate.csv", "Application: i-control\nDevice: infinite 200Pro\n\nMode,Absorbance\n\n" + line("Cycle Nr.", range(1, n + 1)) + line("Time [s]", t)
        + line("Temp. [°C]", [37.0] * n) + line("A1", u) + line("A2", y)), "lag", {"u": "A1", "y": "A2"}
    lvm = "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\n"\
        "Operator\tx\nDate\t2026/09/21\nTime\t14:13:57.1\n***End_of_Header***\t\n\t\nChannels\t2\t\t\t\nSamples\t200\t200\t\t\nX_Dimension\tTime\tTime\t\t\nX0\t0.0E+0\t0.0E+0\t\t\n"\
        "Delta_X\t0.020000\t0.020000\t\t\n***End_of_Header***\t\t\t\t\n"
    yield "measurement file with two headers", put("l.lvm", lvm + "X_Value\tu\ty\tComment\n" + rows([t, u, y, [""] * n], "\t")), "lag", {}
    yield "controller: time, path, value, type by bars, no header", put("cds.csv", "".join(
        f"{int(1_790_000_000_000 + a)}|App.u|{b}|REAL\n{int(1_790_000_000_000 + a)}|App.y|{d}|REAL\n" for a, b, d in zip(ms, u, y))), "lag", {"u": "App.u", "y": "App.y"}
    yield "oscilloscope: sequence, start and increment", put(
        "rigol.csv", "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,0.000000e+00,2.000000e-02\n" + rows([list(range(n)), u, y, [""] * n, [""] * n], ",")), "lag", {
            "u": "CH1", "y": "CH2 [1]"}
    about = ["Record Length,200", "Sample Interval,0.02", "Trigger Point,1", "", "Source,CH1", "Vertical Units,V", "Vertical Scale,0.5", "Horizontal Units,s"]
    side = [about[k] + "," * (1 - about[k].count(",")) if k < len(about) else "," for k in range(n)]
    yield "oscilloscope: settings beside the samples, no names", put(
        "tek.csv", "".join(f"{s},,{a:.5f},{b:.4f},{d:.5f},\n" for s, a, b, d in zip(side, t, u, y))), "lag", {"t": "#4 [s]", "u": "#5", "y": "#6"}
    yield "oscilloscope: x-axis, second, Volt", put("key.csv", "x-axis,1,2\nsecond,Volt,Volt\n" + rows([t, u, y])), "lag", {"u": "1", "y": "2 [1]"}
    yield "telephone in a car: two clocks, blanks, dashes", put(
        "trq.csv", "GPS Time, Device Time, Longitude, Horizontal Dilution of Precision, u(V), y\n" + "".join(
            f"Mon Sep 21 14:{int(clock(a)[0]):02d}:{int(clock(a)[1]):02d} GMT+02:00 2026, 21-Sep-2026 {stamp(a)}, 11.5, -, {b:.4f}, {d:.5f}\n" for a, b, d in zip(t, u, y))), "lag", {}
    yield "telephone: nanoseconds since 1970 beside seconds elapsed", put(
        "sl.csv", "time,seconds_elapsed,z,y,u\n" + rows([[1_790_000_000_000_000_000 + int(round(v * 1e6)) * 1000 for v in t], t, [9.8] * n, y, u])), "lag", {}
    yield "telephone: quoted, exponents, empty unit", put(
        "phy.csv", '"Time (s)","u (V)","y ()"\n' + rows([t, u, y], ",", "{:.9E}")), "lag", {}
    yield "data frame with an index of time differences", put("pd.csv", ",u,y\n" + "".join(
        f"0 days 00:00:{a:09.6f},{b:.4f},{d:.5f}\n" for a, b, d in zip(t, u, y))), "lag", {}
    yield "timetable: 0.02 sec", put("tt.csv", "Time,u,y\n" + "".join(f"{a:g} sec,{b:.4f},{d:.5f}\n" for a, b, d in zip(t, u, y))), "lag", {}
    pipe = lambda cells: "".join(f"{c:>14} |" for c in cells) + "\n"
    yield "flight simulator: bars and underlines", put(
        "xp.txt", "\n\n" + pipe(["_real,_time", "u,____V", "y,_____"]) + "".join(pipe([f"{a:.5f}", f"{b:.5f}", f"{d:.5f}"]) for a, b, d in zip(t, u, y))), "lag", {
            "u": "u,____V", "y": "y,_____"}
