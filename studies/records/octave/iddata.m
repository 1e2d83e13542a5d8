classdef iddata
% Stands in for the class of MATLAB's System Identification Toolbox: the properties that fdm_export reads, as MathWorks documents them.
  properties
    SamplingInstants
    InputData
    OutputData
    InputName = {}
    OutputName = {}
    InputUnit = {}
    OutputUnit = {}
    TimeUnit = 'seconds'
  end
end
