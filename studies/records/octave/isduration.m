function is = isduration(x)
  is = isa(x, 'duration');
end
