//! Three mistakes of names, all told at once, the nearest name beside each.

fn main() {
    let _ship = fdm::model! {
        model ship {
            input rudder;
            state speed, yaw;
            param drag = 1, drag = 2;
            der(speed) = -drag*sped^2;   // speed
            der(yaw) = sinus(rudder);
            output speed_m = speed;
        }
    };
}
