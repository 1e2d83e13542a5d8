//! A reader of DAVE-ML that knows of the standard only what gridded tables and check cases need, and nothing of fdm.

use roxmltree::{Document, Node, ParsingOptions};
use std::collections::BTreeMap;

/// A function on its grid.
struct Function {
    /// Names of the variables that it depends on, with their breakpoints.
    axes: Vec<(String, Vec<f64>)>,
    values: Vec<f64>,
}

/// All functions of a file, by the names of the variables that they give.
pub(crate) struct Functions(BTreeMap<String, Function>);

/// A check case.
pub(crate) struct Case {
    /// Signals and their values.
    pub(crate) inputs: Vec<(String, f64)>,
    /// The same with tolerances.
    pub(crate) outputs: Vec<(String, f64, f64)>,
}

fn document(text: &str) -> Document<'_> {
    Document::parse_with_options(text, ParsingOptions { allow_dtd: true, ..ParsingOptions::default() }).unwrap()
}

fn below<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.descendants().filter(move |n| n.tag_name().name() == name)
}

fn text<'a>(node: Node<'a, 'a>, name: &'static str) -> &'a str {
    below(node, name).next().unwrap_or_else(|| panic!("no {name}")).text().unwrap().trim()
}

fn list(text: &str) -> Vec<f64> {
    text.split([',', ' ', '\n']).filter(|t| !t.is_empty()).map(|t| t.parse().unwrap()).collect()
}

/// The element of a kind with this attribute.
fn find<'a>(root: Node<'a, 'a>, kind: &'static str, key: &str, value: &str) -> Node<'a, 'a> {
    below(root, kind).find(|n| n.attribute(key) == Some(value)).unwrap_or_else(|| panic!("no {kind} {value}"))
}

impl Functions {
    pub(crate) fn read(source: &str) -> Self {
        let document = document(source);
        let root = document.root_element();
        assert_eq!(root.tag_name().namespace(), Some("http://daveml.org/2010/DAVEML"));
        let name = |id: &str| find(root, "variableDef", "varID", id).attribute("name").unwrap().to_string();
        let one = |function: Node<'_, '_>| {
            let table = below(function, "griddedTableRef").next().unwrap().attribute("gtID").unwrap();
            let table = find(root, "griddedTableDef", "gtID", table);
            let arguments = below(function, "independentVarRef").map(|n| {
                assert_eq!((n.attribute("extrapolate"), n.attribute("interpolate")), (Some("neither"), Some("linear")));
                name(n.attribute("varID").unwrap())
            });
            let axes = below(table, "bpRef")
                .map(|n| list(text(find(root, "breakpointDef", "bpID", n.attribute("bpID").unwrap()), "bpVals")));
            let values = table.children().find(|n| n.tag_name().name() == "dataTable").unwrap();
            let gives = below(function, "dependentVarRef").next().unwrap().attribute("varID").unwrap();
            (name(gives), Function { axes: arguments.zip(axes).collect(), values: list(values.text().unwrap()) })
        };
        Self(below(root, "function").map(one).collect())
    }

    pub(crate) fn names(&self) -> Vec<&str> {
        self.0.keys().map(String::as_str).collect()
    }

    /// Linear along one argument after the other; the last argument varies fastest.
    pub(crate) fn value(&self, name: &str, inputs: &[(String, f64)]) -> f64 {
        let function = &self.0[name];
        let mut values = function.values.clone();
        for (argument, axis) in function.axes.iter().rev() {
            let x = inputs.iter().find(|(name, _)| name == argument).unwrap().1;
            let x = x.max(axis[0]).min(*axis.last().unwrap());
            let k = (0..axis.len() - 2).find(|k| x < axis[k + 1]).unwrap_or(axis.len() - 2);
            let part = (x - axis[k]) / (axis[k + 1] - axis[k]);
            values = values.chunks_exact(axis.len()).map(|row| row[k] + part * (row[k + 1] - row[k])).collect();
        }
        assert_eq!(values.len(), 1);
        values[0]
    }
}

/// The check cases of a file.
pub(crate) fn cases(source: &str) -> Vec<Case> {
    let document = document(source);
    let signals = |node: Node<'_, '_>, kind: &'static str| -> Vec<(String, f64, f64)> {
        let signal = |n: Node<'_, '_>| {
            let tolerance = below(n, "tol").next().map_or(0.0, |t| t.text().unwrap().trim().parse().unwrap());
            (text(n, "signalName").to_string(), text(n, "signalValue").parse().unwrap(), tolerance)
        };
        below(node, kind).flat_map(|n| below(n, "signal").map(signal).collect::<Vec<_>>()).collect()
    };
    let case = |shot: Node<'_, '_>| Case {
        inputs: signals(shot, "checkInputs").into_iter().map(|(name, value, _)| (name, value)).collect(),
        outputs: signals(shot, "checkOutputs"),
    };
    below(document.root_element(), "staticShot").map(case).collect()
}
