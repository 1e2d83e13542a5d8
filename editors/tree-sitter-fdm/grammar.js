// The fdm language for editors: a grammar that also reads what is being typed. The compiler's own is grammar/fdm.pest.
// Written without anything but `grammar`, so that src/grammar.json follows from it by `tree-sitter generate --no-parser`.

const STRENGTH = { choice: 0, or: 1, and: 2, not: 3, comparison: 4, sum: 5, product: 6, sign: 7, power: 8 };

const list = (item) => seq(item, repeat(seq(',', item)));

module.exports = grammar({
  name: 'fdm',
  word: ($) => $.identifier,
  extras: ($) => [/\s/, /\uFEFF/, $.comment],
  supertypes: ($) => [$.statement, $.expression],

  rules: {
    source_file: ($) => repeat(choice($.model, $.effect)),

    model: ($) => seq('model', field('name', $.identifier), optional(field('doc', $.string)), $.block),
    block: ($) => seq('{', repeat(choice($.statement, ';')), '}'),

    // what may be missing from a model
    effect: ($) =>
      seq(
        'effect',
        field('name', $.identifier),
        $.slots,
        repeat(choice($.condition, field('doc', $.string))),
        $.effect_block,
      ),
    slots: ($) => seq('(', list($.slot), ')'),
    slot: ($) => seq(field('name', $.identifier), ':', $.kind, repeat(seq('|', $.kind))),
    kind: ($) => choice($.role, $.identifier),
    condition: ($) => seq(choice('unless', 'when'), $.expression),
    role: () => choice('input', 'known', 'state', 'param', 'const', 'let', 'output'),
    effect_block: ($) =>
      seq(
        '{',
        repeat(choice($.tunable, $.effect_declarations, $.addition, $.replacement, $.noise, $.equation, ';')),
        '}',
      ),
    tunable: ($) =>
      seq(
        choice('param', 'nuisance'),
        field('name', $.identifier),
        repeat(choice($.string, $.unit, $.value, $.trials, 'fixed', $.per_run)),
        ';',
      ),
    trials: ($) => prec.right(seq(choice('try', 'in'), list($.expression))),
    effect_declarations: ($) => seq(choice('state', 'let', 'const'), list($.declaration), ';'),
    addition: ($) => seq('add', $.expression, '+=', $.expression, ';'),
    replacement: ($) => seq('replace', field('name', $.identifier), 'with', $.expression, ';'),

    statement: ($) =>
      choice(
        $.declarations,
        $.scheduled,
        $.equation,
        $.time,
        $.prior,
        $.noise,
        $.trim,
        $.tie,
        $.table,
        $.smooth,
        $.requirement,
        $.limit,
        $.when,
        $.use,
        $.reactions,
      ),

    declarations: ($) => seq($.role, list($.declaration), ';'),
    declaration: ($) =>
      seq(
        field('name', $.identifier),
        optional(field('shape', $.index)),
        repeat(choice($.string, $.unit, $.value, $.bounds, 'fixed', $.per_run, $.per_group, $.by_log, $.hold, $.wrap)),
      ),
    scheduled: ($) =>
      seq(
        $.role,
        field('name', $.identifier),
        '(',
        list($.argument),
        ')',
        repeat(choice($.string, $.unit, $.bounds)),
        '=',
        optional(field('method', choice('linear', 'cubic', 'pchip'))),
        $.expression,
        'at',
        list($.expression),
        ';',
      ),
    value: ($) => seq('=', choice('free', $.expression)),
    bounds: ($) => seq('in', '[', $.expression, ',', $.expression, ']'),
    per_run: () => seq('per', 'run'),
    per_group: ($) => seq('per', 'group', field('grouping', $.identifier)),
    by_log: () => 'log',
    hold: () => choice('held', 'linear'),
    wrap: ($) => seq('wrap', $.number, optional(seq('*', 'pi'))),

    equation: ($) => seq($.expression, '=', $.expression, ';'),
    time: ($) => seq('time', $.unit, ';'),
    prior: ($) => seq('prior', list($.belief), ';'),
    belief: ($) => seq($.expression, '~', $.expression),
    noise: ($) => seq('noise', list($.setting), ';'),
    tie: ($) => seq('tie', list($.setting), ';'),
    trim: ($) => seq('trim', '{', repeat(seq($.setting, ';')), '}'),
    when: ($) => seq('when', field('condition', $.expression), '{', repeat(seq($.setting, ';')), '}'),
    setting: ($) => seq(choice($.reference, $.element, $.call), '=', $.expression),

    table: ($) =>
      seq(
        'table',
        field('name', $.identifier),
        '(',
        list($.argument),
        ')',
        repeat(choice($.string, $.unit)),
        '=',
        field('method', $.identifier),
        choice($.points, $.from),
        ';',
      ),
    argument: ($) => seq(field('name', $.identifier), optional($.unit)),
    from: ($) => seq('from', field('path', $.string), optional('free')),
    smooth: ($) => seq('smooth', field('table', $.identifier), 'by', 'order', $.number, ';'),
    requirement: ($) => seq('requirement', list($.declaration), ';'),
    limit: ($) => seq('limit', list($.limited), ';'),
    limited: ($) => seq(field('state', choice($.reference, $.element)), $.bounds, optional(seq('smooth', $.expression))),
    points: ($) => seq('{', list($.point), optional(','), '}'),
    point: ($) => seq($.expression, ':', choice($.expression, seq('free', optional($.expression)))),

    use: ($) =>
      seq('use', optional('fmu'), field('path', choice($.string, $.identifier)), 'as', field('name', $.identifier), optional($.connections), ';'),
    connections: ($) => seq('(', optional(list($.connection)), ')'),
    connection: ($) => seq(field('name', $.identifier), '=', $.expression),

    reactions: ($) => seq('reactions', optional(seq('in', $.expression)), '{', repeat(seq($.reaction, ';')), '}'),
    reaction: ($) => seq($.side, choice('->', '<->'), $.side, ':', list($.expression)),
    side: ($) => seq($.portion, repeat(seq('+', $.portion))),
    portion: ($) =>
      choice($.number, seq(optional(seq($.number, optional('*'))), optional(seq(field('factor', $.reference), '*')), choice($.reference, $.element))),

    expression: ($) =>
      choice(
        $.number,
        $.reference,
        $.element,
        $.call,
        $.group,
        $.vector,
        $.choice,
        $.unary,
        $.binary,
      ),
    group: ($) => seq('(', $.expression, ')'),
    vector: ($) => seq('[', list($.expression), ']'),
    call: ($) => prec(10, seq(field('function', $.reference), '(', optional(list($.expression)), ')')),
    element: ($) => seq($.reference, $.index),
    reference: ($) => prec.right(seq($.identifier, repeat(seq(token.immediate('.'), $.identifier)))),
    choice: ($) =>
      prec.right(
        STRENGTH.choice,
        seq('if', $.expression, 'then', $.expression, 'else', $.expression),
      ),
    unary: ($) =>
      choice(
        prec(STRENGTH.sign, seq(choice('-', '+'), $.expression)),
        prec(STRENGTH.not, seq('not', $.expression)),
      ),
    binary: ($) =>
      choice(
        prec.left(STRENGTH.or, seq($.expression, 'or', $.expression)),
        prec.left(STRENGTH.and, seq($.expression, 'and', $.expression)),
        prec.left(STRENGTH.comparison, seq($.expression, choice('<', '<=', '>', '>=', '==', '!='), $.expression)),
        prec.left(STRENGTH.sum, seq($.expression, choice('+', '-'), $.expression)),
        prec.left(STRENGTH.product, seq($.expression, choice('*', '/'), $.expression)),
        prec.right(STRENGTH.power, seq($.expression, '^', $.expression)),
      ),

    // `x[2]`, `A[1, 2:3]`: no space stands before it
    index: () => token.immediate(prec(2, /\[[ \t]*(\d+|:)[0-9:, \t]*\]/)),
    unit: () => token(prec(1, /\[[^\[\]{};"\r\n]*\]/)),
    string: () => /"[^"\r\n]*"/,
    number: () => /(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?/,
    identifier: () => /[_\p{XID_Start}][\p{XID_Continue}]*/,
    comment: () => token(choice(/\/\/[^\r\n]*/, /\/\*[^*]*\*+([^/*][^*]*\*+)*\//)),
  },
});
