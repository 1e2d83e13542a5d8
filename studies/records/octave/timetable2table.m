function t = timetable2table(x, varargin)
  assert(isequal(varargin, {'ConvertRowTimes', false}));
  t = table();
  t.p = x.p;
  t.xyz = x.xyz;
  t.note = x.note;
  t.Properties = x.Properties;
end
