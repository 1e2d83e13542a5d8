//! Files for the tests, written here: loggers of vehicles have no writers elsewhere.

/// Samples of a small flight: rates at 1/128 s, an attitude at 1/64 s, one command a second.
pub(crate) const ROWS: usize = 256;

/// Microseconds of a sample.
pub(crate) fn micros(k: usize, step: usize) -> u64 {
    1_000_000 + (k * step) as u64 * 7813
}

/// The rate of a sample about an axis.
pub(crate) fn rate(k: usize, axis: usize) -> f32 {
    ((k * k + 31 * axis) % 97) as f32 / 16.0 - 3.0
}

fn ulog_message(out: &mut Vec<u8>, kind: u8, body: &[u8]) {
    out.extend((body.len() as u16).to_le_bytes());
    out.push(kind);
    out.extend(body);
}

/// A log of PX4.
pub(crate) fn ulog() -> Vec<u8> {
    let mut out = b"ULog\x01\x12\x35\x01".to_vec();
    out.extend(1_000_000_u64.to_le_bytes());
    ulog_message(&mut out, b'B', &[0; 40]);
    for format in [
        "vehicle_angular_velocity:uint64_t timestamp;float[3] xyz;",
        "vehicle_attitude:uint64_t timestamp;float[4] q;uint8_t flag;uint8_t[3] _padding0;",
        "vehicle_torque_setpoint:uint64_t timestamp;float[3] xyz;",
    ] {
        ulog_message(&mut out, b'F', format.as_bytes());
    }
    ulog_message(&mut out, b'I', b"\x11char[3] sys_nameXPX4");
    let names = ["vehicle_angular_velocity", "vehicle_attitude", "vehicle_torque_setpoint"];
    for (id, name) in names.iter().enumerate() {
        let mut body = vec![0];
        body.extend((id as u16).to_le_bytes());
        body.extend(name.bytes());
        ulog_message(&mut out, b'A', &body);
    }
    let data = |out: &mut Vec<u8>, id: u16, time: u64, values: &[f32], tail: &[u8]| {
        let mut body = id.to_le_bytes().to_vec();
        body.extend(time.to_le_bytes());
        values.iter().for_each(|v| body.extend(v.to_le_bytes()));
        body.extend(tail);
        ulog_message(out, b'D', &body);
    };
    for k in 0..ROWS {
        if k % 128 == 0 {
            data(&mut out, 2, micros(k, 1), &[k as f32 / 256.0, 0.0, 0.0], &[]);
        }
        data(&mut out, 0, micros(k, 1), &[0, 1, 2].map(|axis| rate(k, axis)), &[]);
        if k % 2 == 0 {
            // padding at the end is not written
            data(&mut out, 1, micros(k, 1), &[1.0, 0.0, 0.0, 0.0], &[7]);
        }
    }
    ulog_message(&mut out, b'O', &20_u16.to_le_bytes());
    out
}

fn dataflash_format(out: &mut Vec<u8>, kind: u8, name: &str, format: &str, labels: &str) {
    let size = |letter: char| match letter {
        'b' | 'B' => 1,
        'c' => 2,
        'f' => 4,
        'd' | 'Q' => 8,
        'n' => 4,
        'N' => 16,
        _ => 64,
    };
    out.extend([0xa3, 0x95, 0x80, kind, 3 + format.chars().map(size).sum::<usize>() as u8]);
    for (text, width) in [(name, 4), (format, 16), (labels, 64)] {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(width, 0);
        out.extend(bytes);
    }
}

/// A log of ArduPilot with two inertial units.
pub(crate) fn dataflash() -> Vec<u8> {
    let mut out = Vec::new();
    let formats = [
        (0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        (1, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        (2, "UNIT", "QbZ", "TimeUS,Id,Label"),
        (3, "MULT", "Qbd", "TimeUS,Id,Mult"),
        (4, "IMU", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
        (5, "ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw"),
        (6, "MSG", "QZ", "TimeUS,Message"),
    ];
    formats.iter().for_each(|(kind, name, format, labels)| dataflash_format(&mut out, *kind, name, format, labels));
    let message = |out: &mut Vec<u8>, kind: u8, time: u64, body: &[u8]| {
        out.extend([0xa3, 0x95, kind]);
        out.extend(time.to_le_bytes());
        out.extend(body);
    };
    let wide = |text: &str, width: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(width, 0);
        bytes
    };
    for (id, label) in [("s", "s"), ("E", "rad/s"), ("d", "deg"), ("#", "instance")] {
        message(&mut out, 2, 0, &[id.as_bytes(), &wide(label, 64)].concat());
    }
    for (id, factor) in [(b'-', 0.0_f64), (b'0', 1.0), (b'F', 1e-6), (b'B', 0.01)] {
        message(&mut out, 3, 0, &[&[id][..], &factor.to_le_bytes()].concat());
    }
    for (kind, units, factors) in [(4, "s#EEE", "F-000"), (5, "sddd", "FBBB")] {
        message(&mut out, 1, 0, &[&[kind][..], &wide(units, 16), &wide(factors, 16)].concat());
    }
    for k in 0..ROWS {
        for unit in 0..2_u8 {
            let mut body = vec![unit];
            (0..3).for_each(|axis| body.extend((rate(k, axis) + f32::from(unit)).to_le_bytes()));
            message(&mut out, 4, micros(k, 1), &body);
        }
        if k % 2 == 0 {
            let angles = [k as i16, -(k as i16), 50];
            message(&mut out, 5, micros(k, 1), &angles.map(i16::to_le_bytes).concat());
        }
    }
    message(&mut out, 6, micros(ROWS, 1), &wide("landed", 64));
    out
}
