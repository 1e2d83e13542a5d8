(comment) @comment
(string) @string
(number) @number
(unit) @type
(index) @number

[
  "model" "time" "prior" "noise" "trim" "tie" "table" "smooth" "requirement" "limit" "when" "by" "order" "from" "use" "fmu" "as" "reactions"
  "effect" "nuisance" "param" "add" "replace" "with" "try" "unless" "when"
] @keyword
(role) @keyword
(effect_declarations ["state" "let" "const"] @keyword)
["in" "fixed" "free" "per" "run"] @attribute
(by_log) @attribute
(hold) @attribute
(per_group "group" @attribute)
(wrap "wrap" @attribute)
["if" "then" "else"] @keyword.conditional
["and" "or" "not"] @keyword.operator
["+" "-" "*" "/" "^" "<" "<=" ">" ">=" "==" "!=" "=" "+=" "~" "|" "->" "<->"] @operator
["(" ")" "[" "]" "{" "}"] @punctuation.bracket
["," ";" ":"] @punctuation.delimiter

(reference) @variable
(call function: (reference) @function.call)
((call function: (reference) @function.builtin)
  (#any-of? @function.builtin
    "sin" "cos" "tan" "asin" "acos" "atan" "atan2" "sinh" "cosh" "tanh" "exp" "log" "log10" "sqrt" "abs" "sign" "min"
    "max" "hypot" "clip" "deadzone" "deg2rad" "rad2deg" "delay" "der" "measured" "initial" "lag" "leadlag" "washout"
    "second_order" "tf" "normal" "arrhenius" "reaction"))
((reference) @constant.builtin (#any-of? @constant.builtin "t" "pi" "inf"))

(model name: (identifier) @module)
(effect name: (identifier) @module)
(declaration name: (identifier) @variable.definition)
(tunable name: (identifier) @variable.definition)
(table name: (identifier) @function.definition)
(use name: (identifier) @module)
(table method: (identifier) @keyword)
